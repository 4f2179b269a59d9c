"""OpenVINO beside onnxruntime: with a stand-in where its package is missing, and itself where it is there."""

import importlib
import sys
import threading
from types import SimpleNamespace

import numpy as np
import pytest
from blobs import Blobs

from panoptic_ros.detection.backends import choice, openvino
from panoptic_ros.detection.backends.onnx import OnnxNetwork
from panoptic_ros.detection.backends.openvino import NAME
from panoptic_ros.errors import BackendError

CARD, NETWORK = Blobs.heads_card(), Blobs.heads_network()
PICTURE = np.random.default_rng(3).integers(0, 255, (1, 64, 96, 3)).astype(np.uint8)


class StandIn:
    """Computes with onnxruntime; keeps what it was asked for."""

    capable, settings = ["FP32", "BF16"], []

    def read_model(self, data):
        return OnnxNetwork(CARD, data)

    def get_property(self, device, name):
        return self.capable

    def compile_model(self, model, device, settings):
        self.settings.append((threading.get_ident(), settings))

        def infer(inputs):
            ((_, tensor),) = inputs.items()
            ports = {role: SimpleNamespace(names={CARD.output[role], "other"}) for role in CARD.output}
            return SimpleNamespace(items=lambda: [(ports[r], v) for r, v in model.run(tensor).items()])

        return SimpleNamespace(create_infer_request=lambda: SimpleNamespace(infer=infer))


@pytest.fixture
def stand_in(monkeypatch):
    StandIn.settings = []
    monkeypatch.setitem(sys.modules, "openvino", SimpleNamespace(Core=StandIn))
    monkeypatch.delitem(sys.modules, "openvino_telemetry", raising=False)
    monkeypatch.setattr(choice, "is_installed", lambda: True)
    return StandIn


def test_its_provider_is_run_by_its_package_where_onnxruntime_lacks_it(stand_in):
    network = choice.open_network(CARD, NETWORK, (NAME, "CPUExecutionProvider"), 1)
    wanted = choice.open_network(CARD, NETWORK).run(PICTURE)
    assert network.providers == (NAME,) and NAME in choice.available_providers()
    for role, values in network.run(PICTURE).items():
        np.testing.assert_array_equal(values, wanted[role])
    ((_, settings),) = stand_in.settings
    assert settings["INFERENCE_PRECISION_HINT"] == "bf16" and settings["INFERENCE_NUM_THREADS"] == 1


def test_every_thread_has_a_network_of_its_own(stand_in):
    network = choice.open_network(CARD, NETWORK, (NAME,), 1)
    threads = [threading.Thread(target=lambda: [network.run(PICTURE) for _ in range(2)]) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(stand_in.settings) == 3


def test_full_precision_where_the_processor_has_nothing_else(stand_in, monkeypatch):
    monkeypatch.setattr(StandIn, "capable", ["FP32"])
    choice.open_network(CARD, NETWORK, (NAME,), 1)
    assert stand_in.settings[0][1]["INFERENCE_PRECISION_HINT"] == "f32"


def test_a_missing_package_is_told_with_what_to_do(monkeypatch):
    monkeypatch.setitem(sys.modules, "openvino", None)
    with pytest.raises(BackendError, match="python -m pip install openvino"):
        choice.open_network(CARD, NETWORK, (NAME,), 1)


def test_its_telemetry_cannot_be_imported(stand_in):
    choice.open_network(CARD, NETWORK, (NAME,), 1)
    with pytest.raises(ImportError):
        importlib.import_module("openvino_telemetry")


def test_a_telemetry_that_the_process_has_imported_stays(stand_in, monkeypatch):
    imported = SimpleNamespace()
    monkeypatch.setitem(sys.modules, "openvino_telemetry", imported)
    choice.open_network(CARD, NETWORK, (NAME,), 1)
    assert sys.modules["openvino_telemetry"] is imported


@pytest.mark.skipif(not openvino.is_installed(), reason="the package openvino is not installed")
def test_the_package_itself_gives_what_onnxruntime_gives():
    own = choice.open_network(CARD, NETWORK, (NAME,), 1).run(PICTURE)
    for role, values in choice.open_network(CARD, NETWORK).run(PICTURE).items():
        assert own[role].shape == values.shape
        assert np.abs(own[role] - values).max() <= 0.02 * max(1.0, np.abs(values).max())
