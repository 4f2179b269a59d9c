"""Inference with the package openvino, in bfloat16 where the processor supports it.

It serves onnxruntime packages without OpenVINO's provider, such as those of PyPI. The provider that is
available as a plugin excludes processors of other makers than Intel.

Importing openvino reports the import to a web service, if the package openvino_telemetry is installed. This
module is the only one that imports openvino, and it prevents the import of openvino_telemetry.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
import threading
from typing import Any

import numpy as np

from panoptic_ros.detection.backends.onnx import OnnxNetwork
from panoptic_ros.detection.card import ModelCard
from panoptic_ros.errors import BackendError

Array = np.ndarray
NAME = "OpenVINOExecutionProvider"  # name of the provider in onnxruntime


def is_installed() -> bool:
    """Return whether the package openvino is installed."""
    return importlib.util.find_spec("openvino") is not None


def _without_telemetry() -> Any:
    """Import openvino without its telemetry, unless this process has imported openvino_telemetry already.

    None in `sys.modules` makes the import of openvino_telemetry fail. openvino then uses its own stub, as it
    does where the package is not installed. The user's consent file is neither read nor changed.

    Raises:
        ImportError: openvino is not installed.
    """
    sys.modules.setdefault("openvino_telemetry", None)  # type: ignore[arg-type]  # None: typeshed omits it
    return importlib.import_module("openvino")


class OpenVinoNetwork:
    """Network run by OpenVINO, with the interface of `OnnxNetwork`. Each thread has its own compiled copy.

    Raises:
        BackendError: as `OnnxNetwork`; also if the package is missing or cannot compile the network.
    """

    def __init__(self, card: ModelCard, onnx_bytes: bytes, threads: int = 1):
        self.card = card
        self.batch_limit = OnnxNetwork(card, onnx_bytes).batch_limit  # also checks the tensors
        try:
            openvino: Any = _without_telemetry()
        except ImportError as error:
            raise BackendError(
                f"{NAME} is not in this onnxruntime, and the package openvino cannot be loaded ({error}): "
                "python -m pip install openvino"
            ) from None
        try:
            self._core: Any = openvino.Core()
            self._model = self._core.read_model(onnx_bytes)
            capable = self._core.get_property("CPU", "OPTIMIZATION_CAPABILITIES")
        except RuntimeError as error:
            raise BackendError(f"OpenVINO cannot read model {card.name}: {_first_line(error)}") from None
        self.precision = "bf16" if "BF16" in capable else "f32"
        self._threads = threads
        self._own = threading.local()
        self._roles = {card.output[role]: role for role in card.output}
        self._request()  # report compile errors at construction

    @property
    def providers(self) -> tuple[str, ...]:
        """Return the name of OpenVINO's execution provider."""
        return (NAME,)

    def run(self, tensor: Array) -> dict[str, Array]:
        """Return the outputs by role for an input tensor.

        Raises:
            BackendError: if OpenVINO fails.
        """
        try:
            values = self._request().infer({self.card.input.name: tensor})
        except RuntimeError as error:
            raise BackendError(f"model {self.card.name} failed: {_first_line(error)}") from None
        named = {name: value for port, value in values.items() for name in port.names}
        return {role: np.array(named[name]) for name, role in self._roles.items()}

    def _request(self) -> Any:
        """Return the inference request of the calling thread; compile the network on its first call.

        Raises:
            BackendError: if OpenVINO cannot compile the network.
        """
        if not hasattr(self._own, "request"):
            settings = {
                "INFERENCE_PRECISION_HINT": self.precision,
                "INFERENCE_NUM_THREADS": self._threads,
                "NUM_STREAMS": 1,
                "ENABLE_CPU_PINNING": False,
            }
            try:
                compiled = self._core.compile_model(self._model, "CPU", settings)
                self._own.request = compiled.create_infer_request()
            except RuntimeError as error:
                raise BackendError(
                    f"OpenVINO cannot compile model {self.card.name}: {_first_line(error)}"
                ) from None
        return self._own.request


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or ["no reason given"])[0][:200]
