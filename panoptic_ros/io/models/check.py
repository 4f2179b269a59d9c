"""Run a model once on a generated image, and compare its outputs with the expected ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from panoptic_ros.detection.backends.choice import open_network
from panoptic_ros.detection.model import DetectorModel
from panoptic_ros.errors import BackendError
from panoptic_ros.io.models.cards import CardFile

Array = np.ndarray
PICTURE_SIZE = (96, 128)  # height, width; small, so that a check takes a fraction of a second
TOLERANCE = 5e-3


@dataclass(frozen=True)
class CheckResult:
    """Output shapes by role, and whether the values were compared with expected ones."""

    shapes: dict[str, tuple[int, ...]]
    compared: bool


def made_picture(height: int, width: int) -> Array:
    """Generate an image (H, W, 3) uint8 of smooth waves, identical on every machine."""
    rows, columns = np.mgrid[0:height, 0:width]
    waves = [(rows * (3 + k) + columns * (5 - k)) % 256 for k in range(3)]
    return np.stack(waves, axis=-1).astype(np.uint8)


def check_model(model: DetectorModel, source: CardFile, providers: Sequence[str] = ()) -> CheckResult:
    """Run a loaded model once.

    Raises:
        BackendError: if it fails, or if its outputs are not finite or differ from the expected ones.
    """
    card = model.card
    network = open_network(card, model.onnx_bytes, providers)
    height, width = card.input.size or PICTURE_SIZE
    tensor = made_picture(height, width)[None].astype(card.input.dtype)
    if card.input.layout == "NCHW":
        tensor = np.ascontiguousarray(tensor.transpose(0, 3, 1, 2))
    outputs = network.run(tensor)
    for role, values in outputs.items():
        if not np.isfinite(values).all():
            raise BackendError(f"model {card.name}: output {role} has values that are not finite")
    known = dict(source.origin.mean_outputs) if source.origin else {}
    for role, expected in known.items():
        mean = float(np.abs(outputs[role]).mean())
        if abs(mean - expected) > TOLERANCE * max(expected, 0.01):
            raise BackendError(
                f"model {card.name}: the mean of {role} is {mean:.6f} on the test picture, expected "
                f"{expected:.6f}; fetch it again, or use another execution provider"
            )
    return CheckResult({role: values.shape for role, values in outputs.items()}, bool(known))
