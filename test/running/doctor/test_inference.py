"""Providers are measured, those that are missing are said to be unmeasured, the quickest is recommended."""

import pytest
from blobs import Blobs

from panoptic_ros.detection.model import DetectorModel
from panoptic_ros.errors import BackendError
from panoptic_ros.running.doctor.checks import PROVIDERS, judged, measured, run_ms

MODEL = DetectorModel(Blobs.heads_card(), Blobs.heads_network())


def test_the_processor_is_measured_here():
    assert 0.0 < run_ms(MODEL, PROVIDERS["CPU"]) < 10_000.0
    with pytest.raises(BackendError, match="NoSuch"):
        run_ms(MODEL, "NoSuchExecutionProvider")


def test_stand_ins_for_what_this_machine_lacks():
    milliseconds = {PROVIDERS["CPU"]: 24.0, PROVIDERS["CUDA"]: 2.5}

    def timer(model, provider):
        if provider == PROVIDERS["TensorRT"]:
            raise BackendError("libnvinfer is missing")
        return milliseconds[provider]

    times, unmeasured = measured(MODEL, list(PROVIDERS.values())[:3], timer)
    assert times == {"CPU": 24.0, "CUDA": 2.5}
    assert unmeasured == {"TensorRT": "libnvinfer is missing", "OpenVINO": "not installed"}
    finding = judged("net", times, unmeasured)
    assert finding.level == "WARN" and "CUDA 2.5 ms, CPU 24.0 ms" in finding.found
    assert "unmeasured: TensorRT (libnvinfer is missing), OpenVINO" in finding.found
    assert "detection.providers=CUDAExecutionProvider,CPUExecutionProvider" in finding.remedy


@pytest.mark.parametrize("times", [{"CPU": 20.0}, {"CPU": 20.0, "OpenVINO": 19.0}, {"CPU": 5.0, "CUDA": 9.0}])
def test_what_is_no_quicker_is_not_recommended(times):
    assert judged("net", times, {}).level == "OK"


def test_nothing_runs_it():
    finding = judged("net", {}, {"CPU": "broken"})
    assert finding.level == "WARN" and "nothing runs it" in finding.found and finding.remedy
