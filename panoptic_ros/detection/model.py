"""A network as it is handed to the stage: its card, its bytes and the one that finds people for it."""

from __future__ import annotations

from dataclasses import dataclass, field

from panoptic_ros.detection.card import ModelCard


@dataclass(frozen=True, eq=False)
class DetectorModel:
    """A checked card and the ONNX file's content.

    Args:
        person_detector: finds the people for a family that works on crops; None = the whole image
            is one crop.
    """

    card: ModelCard
    onnx_bytes: bytes = field(repr=False)
    person_detector: DetectorModel | None = None
