"""Load a model by its name for the detection stage."""

from __future__ import annotations

import hashlib
from pathlib import Path

from panoptic_ros.detection.backends.onnx import OnnxNetwork
from panoptic_ros.detection.card import PERSON_DETECTORS
from panoptic_ros.detection.model import DetectorModel
from panoptic_ros.errors import BackendError
from panoptic_ros.io.loading import read_bytes
from panoptic_ros.io.models.cards import DEFAULT_MODEL, CardFile, read_card
from panoptic_ros.io.models.fetch import expected_digest


def load_detector(name_or_path: str = DEFAULT_MODEL) -> DetectorModel:
    """Load a model by the name or path of its card, or by an ONNX file with a card beside it.

    Raises:
        UsageError, ConfigError: if the card does not exist, or is invalid.
        BackendError: if the model's file is missing, has another SHA-256, is not an ONNX file, or has other
            tensors than the card.
    """
    source = read_card(name_or_path)
    model = _load(source, None)
    if not source.card.detector:
        return model
    finder = read_card(source.card.detector, beside=source.path.parent)
    if finder.card.family not in PERSON_DETECTORS:
        raise BackendError(
            f"model {source.card.name} names {finder.card.name} as its detector, which finds no people: "
            f"its family is {finder.card.family}, needed is one of {', '.join(PERSON_DETECTORS)}"
        )
    return _load(source, _load(finder, None))


def _load(source: CardFile, finder: DetectorModel | None) -> DetectorModel:
    data = _model_bytes(source)
    OnnxNetwork(source.card, data)  # refuses files that are not ONNX or have other tensors
    return DetectorModel(source.card, data, finder)


def _model_bytes(source: CardFile) -> bytes:
    path = Path(source.model_path)
    if not path.is_file():
        if source.origin is not None:
            remedy = f"run: panoptic models fetch {source.card.name}"
        else:
            remedy = f"give its path as `file` in a copy of the card {source.path}"
        raise BackendError(f"model {source.card.name}: there is no file {path}; {remedy}")
    data = read_bytes(path)
    expected = expected_digest(source)
    digest = hashlib.sha256(data).hexdigest()
    if expected and digest != expected:
        raise BackendError(
            f"model {source.card.name}: {path} has SHA-256 {digest}, expected {expected}; "
            + ("run: panoptic models fetch" if source.origin is not None else "not used")
        )
    return data
