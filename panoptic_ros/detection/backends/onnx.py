"""Inference with onnxruntime, after a check of the network against its card.

This is the only module that imports onnxruntime. `panoptic_ros/__init__.py` switches its telemetry off
before; `test/contract/test_no_network.py` checks both.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import onnxruntime
from onnxruntime.capi import onnxruntime_pybind11_state

from panoptic_ros.detection.card import ModelCard, expected_shapes
from panoptic_ros.errors import BackendError

Array = np.ndarray
_DTYPES = {"tensor(uint8)": "uint8", "tensor(float)": "float32"}
# the exceptions of onnxruntime have no common base class except Exception
_RUNTIME_ERRORS = tuple(
    kind
    for kind in vars(onnxruntime_pybind11_state).values()
    if isinstance(kind, type) and issubclass(kind, Exception)
) + (RuntimeError, ValueError)


class OnnxNetwork:
    """Session of onnxruntime. `run` takes the input tensor and returns the outputs by role.

    Args:
        providers: Execution providers in order of preference; empty = the CPU.
        threads: Threads inside one operator. On a busy machine, several are slower than one.

    Raises:
        BackendError: if the bytes are not an ONNX file, a provider is not available, or a tensor differs
            from the card.
    """

    def __init__(self, card: ModelCard, onnx_bytes: bytes, providers: Sequence[str] = (), threads: int = 1):
        self.card = card
        self._session = _open(card, onnx_bytes, _checked_providers(providers), threads)
        _check_tensors(card, self._session)
        first = self._session.get_inputs()[0].shape[0]
        self.batch_limit = first if isinstance(first, int) else None  # None = any number of images
        self._roles = tuple(card.output)
        self._names = [card.output[role] for role in self._roles]

    @property
    def providers(self) -> tuple[str, ...]:
        """Return the execution providers of the session, in its order."""
        return tuple(self._session.get_providers())

    def run(self, tensor: Array) -> dict[str, Array]:
        """Return the outputs by role for an input tensor.

        Raises:
            BackendError: if the runtime fails.
        """
        try:
            values = self._session.run(self._names, {self.card.input.name: tensor})
        except _RUNTIME_ERRORS as error:
            raise BackendError(f"model {self.card.name} failed: {_first_line(error)}") from None
        return dict(zip(self._roles, values))


def runtime_providers() -> list[str]:
    """List the execution providers of the installed onnxruntime, by onnxruntime's names."""
    return list(onnxruntime.get_available_providers())


def _checked_providers(providers: Sequence[str]) -> list[str]:
    available = runtime_providers()
    for name in providers:
        if name not in available:
            raise BackendError(
                f"execution provider {name!r} is not available; onnxruntime has {', '.join(available)}"
            )
    return list(providers) or ["CPUExecutionProvider"]


def _open(card: ModelCard, data: bytes, providers: list[str], threads: int) -> onnxruntime.InferenceSession:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.use_deterministic_compute = True
    options.log_severity_level = 4  # errors are raised; the runtime must not write to the terminal
    try:
        return onnxruntime.InferenceSession(data, options, providers=providers)
    except _RUNTIME_ERRORS as error:
        raise BackendError(
            f"model {card.name} is not an ONNX file that can be run: {_first_line(error)}"
        ) from None


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or ["no reason given"])[0][:200]


def _check_tensors(card: ModelCard, session: onnxruntime.InferenceSession) -> None:
    inputs = {item.name: item for item in session.get_inputs()}
    outputs = {item.name: item for item in session.get_outputs()}
    if set(inputs) != {card.input.name}:
        raise BackendError(
            f"model {card.name}: its inputs are {', '.join(inputs)}, but its card states {card.input.name!r}"
        )
    given = inputs[card.input.name]
    dtype = _DTYPES.get(given.type, given.type)
    if dtype != card.input.dtype:
        raise BackendError(
            f"model {card.name}: input {given.name!r} is {dtype}, but its card states {card.input.dtype}"
        )
    height, width = card.input.size or (None, None)
    planes = (None, 3, height, width) if card.input.layout == "NCHW" else (None, height, width, 3)
    _check_shape(card, f"input {given.name!r}", given.shape, planes)
    for role, expected in expected_shapes(card).items():
        name = card.output[role]
        if name not in outputs:
            raise BackendError(
                f"model {card.name}: it has no output {name!r} ({role}); it has {', '.join(outputs)}"
            )
        _check_shape(card, f"output {name!r} ({role})", outputs[name].shape, expected)


def _check_shape(
    card: ModelCard, label: str, shape: Sequence[int | str | None], expected: Sequence[int | None]
) -> None:
    """Check a shape against the card. A size that the file or the card leaves open matches any size.

    Raises:
        BackendError: if the shapes differ.
    """
    fits = len(shape) == len(expected) and all(
        want is None or not isinstance(have, int) or have == want for have, want in zip(shape, expected)
    )
    if not fits:

        def text(sizes: Sequence[int | str | None]) -> str:
            return " x ".join("any" if size is None else str(size) for size in sizes)

        raise BackendError(
            f"model {card.name}: {label} is {text(shape)}, but its card states {text(expected)}"
        )
