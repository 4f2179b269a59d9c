"""occluders.json, "panoptic-occluders-1"."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.domain import Occluders
from panoptic_ros.errors import DataError, shown
from panoptic_ros.io.documents import LARGEST_TABLES, read_json
from panoptic_ros.io.files import write_bytes
from panoptic_ros.io.known_keys import keys, tell_unknown
from panoptic_ros.io.loading import parsing
from panoptic_ros.io.occluders.meshes import MESHES, read_mesh

Array = np.ndarray
FORMAT = "panoptic-occluders-1"
LARGEST = 1e8  # m of a place, or the index of a vertex
FILE = "occluders.json"  # of a capture folder
KEYS = keys("format units", boxes=[keys("name size centre R")], meshes=[keys("name file vertices triangles")])


def read_occluders(path: Path) -> Occluders:
    """The things of an occluders.json, or of a mesh.

    Raises:
        DataError: naming the file, the entry and what is wrong with it.
    """
    path = Path(path)
    if path.suffix.lower() in MESHES:
        return read_mesh(path)
    try:
        document = read_json(path, LARGEST_TABLES)
    except DataError as error:
        raise DataError(f"{error}; give {FILE}, a .ply or an .obj") from None
    with parsing(path):
        return _things(document, path)


def _things(document: Any, path: Path) -> Occluders:
    if not isinstance(document, Mapping) or document.get("format") != FORMAT:
        found = document.get("format") if isinstance(document, Mapping) else None
        raise DataError(f'{path} has format {shown(found)}, expected "{FORMAT}"')
    tell_unknown(document, KEYS, path)
    if document.get("units", "m") != "m":
        raise DataError(f"{path}: units are {shown(document['units'])}; occluders are in metres, 'm'")
    parts = [_box(item, f"{path}: box {_name(item, i)}") for i, item in _entries(document, "boxes", path)]
    parts += [
        _mesh(item, path.parent, f"{path}: mesh {_name(item, i)}")
        for i, item in _entries(document, "meshes", path)
    ]
    things = Occluders.joined(parts)
    if not len(things.triangles):
        raise DataError(f"{path} has neither boxes nor meshes; add some, or remove the file")
    return things


def write_occluders(path: Path, things: Occluders) -> None:
    """Write them as one mesh, exactly."""
    mesh = {"vertices": things.vertices.tolist(), "triangles": things.triangles.tolist()}
    document = {"format": FORMAT, "units": "m", "meshes": [mesh]}
    write_bytes(Path(path), (json.dumps(document) + "\n").encode())


def _entries(document: Mapping[str, Any], key: str, path: Path) -> list[tuple[int, Any]]:
    entries = document.get(key, [])
    if not isinstance(entries, list) or not all(isinstance(item, Mapping) for item in entries):
        raise DataError(f"{path}: {key} is no list of objects")
    return list(enumerate(entries))


def _name(item: Mapping[str, Any], index: int) -> str:
    return str(item.get("name", f"number {index}"))


def _box(item: Mapping[str, Any], where: str) -> Occluders:
    size = _numbers(item, "size", where, (3,))
    if not (size >= 0.0).all():
        raise DataError(f"{where}: size {size.tolist()} has a negative edge")
    rotation = _numbers(item, "R", where, (3, 3)) if "R" in item else np.eye(3)
    if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3):
        raise DataError(f"{where}: R is no rotation; its columns are the box's axes in the world")
    return Occluders.box(size, rotation, _numbers(item, "centre", where, (3,)))


def _mesh(item: Mapping[str, Any], folder: Path, where: str) -> Occluders:
    if "file" in item:
        return read_mesh(folder / str(item["file"]))
    vertices = _numbers(item, "vertices", where, (-1, 3))
    triangles = _numbers(item, "triangles", where, (-1, 3))
    try:
        return Occluders(vertices, triangles)
    except DataError as error:
        raise DataError(f"{where}: {error}") from None


def _numbers(item: Mapping[str, Any], key: str, where: str, shape: tuple[int, ...]) -> Array:
    """An entry as an array; -1 = any length."""
    try:
        values = np.array(item[key], np.float64)
    except KeyError:
        raise DataError(f"{where} has no {shown(key)}") from None
    except (TypeError, ValueError, OverflowError):
        raise DataError(f"{where}: {key} has something that is no number") from None
    fits = values.ndim == len(shape) and all(n in (-1, m) for n, m in zip(shape, values.shape))
    if not fits or not (np.abs(values) <= LARGEST).all():
        wanted = " x ".join("n" if n < 0 else str(n) for n in shape) + " finite numbers"
        raise DataError(f"{where}: {key} must be {wanted}, at most {LARGEST:g}; its shape is {values.shape}")
    return values
