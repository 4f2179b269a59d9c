"""Which execution provider runs the default network quickest on this machine, in measured milliseconds."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from panoptic_ros.detection.model import DetectorModel
from panoptic_ros.errors import BackendError
from panoptic_ros.running.doctor.finding import Finding, ok, warn

PROVIDERS = {  # of onnxruntime, by what people call them
    "CPU": "CPUExecutionProvider",
    "CUDA": "CUDAExecutionProvider",
    "TensorRT": "TensorrtExecutionProvider",
    "OpenVINO": "OpenVINOExecutionProvider",
}
SIZE = (256, 320)  # net px, height and width: a region of one or two people
RUNS = 5  # the quickest of them counts: others may be busy with something else
GAIN = 1.2  # by which another provider must be quicker to be recommended

Timer = Callable[[DetectorModel, str], float]  # ms of one run with a provider


def run_ms(model: DetectorModel, provider: str) -> float:
    """Milliseconds of one run of a network; the first, in which some compile, is left out.

    Raises:
        BackendError: if the provider cannot run it.
    """
    from panoptic_ros.detection.backends.choice import open_network

    network = open_network(model.card, model.onnx_bytes, (provider,))
    if network.providers[:1] != (provider,):
        raise BackendError(f"{provider} could not be loaded; onnxruntime fell back to {network.providers[0]}")
    tensor = np.zeros((1, *SIZE, 3), np.uint8)
    times = []
    for _ in range(1 + RUNS):
        start = time.perf_counter()
        network.run(tensor)
        times.append(1e3 * (time.perf_counter() - start))
    return min(times[1:])


def check_inference() -> Finding:
    """The default network with every provider that is there."""
    from panoptic_ros.detection.backends.choice import available_providers
    from panoptic_ros.io.models import DEFAULT_MODEL, is_cached, load_detector, read_card

    if not is_cached(read_card(DEFAULT_MODEL)):
        return warn(f"{DEFAULT_MODEL} is not there yet, so nothing was measured", "panoptic models fetch")
    model = load_detector(DEFAULT_MODEL)
    return judged(model.card.name, *measured(model, available_providers(), run_ms))


def measured(
    model: DetectorModel, available: Sequence[str], timer: Timer
) -> tuple[dict[str, float], dict[str, str]]:
    """Milliseconds by the name of a provider, and why others could not be measured."""
    times: dict[str, float] = {}
    unmeasured: dict[str, str] = {}
    for name, provider in PROVIDERS.items():
        if provider not in available:
            unmeasured[name] = "not installed"
            continue
        try:
            times[name] = timer(model, provider)
        except BackendError as error:
            unmeasured[name] = str(error)
    return times, unmeasured


def judged(model: str, times: Mapping[str, float], unmeasured: Mapping[str, str]) -> Finding:
    """One line: what was measured, what was not, and which provider to choose if it is not the default."""
    told = ", ".join(f"{name} {ms:.1f} ms" for name, ms in sorted(times.items(), key=lambda row: row[1]))
    found = f"{model} on {SIZE[1]} x {SIZE[0]} px: {told or 'nothing runs it'}"
    if unmeasured:
        found += f"; unmeasured: {', '.join(f'{name} ({why})' for name, why in unmeasured.items())}"
    if not times:
        return warn(found, "python -m pip install --force-reinstall onnxruntime")
    best = min(times, key=lambda name: times[name])
    if best == "CPU" or GAIN * times[best] > times.get("CPU", np.inf):
        return ok(found)
    choice = f"{PROVIDERS[best]},{PROVIDERS['CPU']}"
    return warn(found, f"--set detection.providers={choice}, unless the device is for something else")
