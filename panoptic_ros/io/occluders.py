"""Read and write known occluders: static objects in the room that hide people from cameras.

`occluders.json` ("panoptic-occluders-1") holds boxes and triangles. Meshes may also be PLY or Wavefront OBJ
files, alone or named by an occluders.json beside them. All coordinates are in metres, in the world frame of
the rig.

Limits: PLY as text or little-endian binary, OBJ without curves. Polygons are split into triangle fans, so
they should be convex. Normals, colours and materials are ignored: surfaces occlude from both sides.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.domain import Occluders
from panoptic_ros.errors import DataError, EnvironmentProblem, one_line, shown
from panoptic_ros.io.documents import LARGEST_TABLES, read_json
from panoptic_ros.io.files import write_bytes
from panoptic_ros.io.known_keys import keys, tell_unknown
from panoptic_ros.io.loading import largest_document, parsing, read_bytes

Array = np.ndarray
FORMAT = "panoptic-occluders-1"
LARGEST = 1e8  # limit of coordinates, m, and of vertex indices
FILE = "occluders.json"  # file name in a capture folder
KEYS = keys("format units", boxes=[keys("name size centre R")], meshes=[keys("name file vertices triangles")])


def read_occluders(path: Path) -> Occluders:
    """Read the occluders of an occluders.json or of a mesh file.

    Raises:
        DataError: naming the file, the entry and the fault.
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
    """Write all occluders as one mesh, with all digits."""
    mesh = {"vertices": things.vertices.tolist(), "triangles": things.triangles.tolist()}
    document = {"format": FORMAT, "units": "m", "meshes": [mesh]}
    write_bytes(Path(path), (json.dumps(document) + "\n").encode())


def _entries(document: Mapping[str, Any], key: str, path: Path) -> list[tuple[int, Any]]:
    entries = document.get(key, [])
    if not isinstance(entries, list) or not all(isinstance(item, Mapping) for item in entries):
        raise DataError(f"{path}: {key} is not a list of objects")
    return list(enumerate(entries))


def _name(item: Mapping[str, Any], index: int) -> str:
    return str(item.get("name", f"number {index}"))


def _box(item: Mapping[str, Any], where: str) -> Occluders:
    size = _numbers(item, "size", where, (3,))
    if not (size >= 0.0).all():
        raise DataError(f"{where}: size {size.tolist()} has a negative edge")
    rotation = _numbers(item, "R", where, (3, 3)) if "R" in item else np.eye(3)
    if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3):
        raise DataError(f"{where}: R is not a rotation; its columns are the box's axes in the world")
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
    """Return an entry as an array of the given shape; -1 = any length."""
    try:
        values = np.array(item[key], np.float64)
    except KeyError:
        raise DataError(f"{where} has no {shown(key)}") from None
    except (TypeError, ValueError, OverflowError):
        raise DataError(f"{where}: {key} has something that is not a number") from None
    fits = values.ndim == len(shape) and all(n in (-1, m) for n, m in zip(shape, values.shape))
    if not fits or not (np.abs(values) <= LARGEST).all():
        wanted = " x ".join("n" if n < 0 else str(n) for n in shape) + " finite numbers"
        raise DataError(f"{where}: {key} must be {wanted}, at most {LARGEST:g}; its shape is {values.shape}")
    return values


MESHES = (".ply", ".obj")
_TYPES = {
    "char": "i1",
    "int8": "i1",
    "uchar": "u1",
    "uint8": "u1",
    "short": "<i2",
    "int16": "<i2",
    "ushort": "<u2",
    "uint16": "<u2",
    "int": "<i4",
    "int32": "<i4",
    "uint": "<u4",
    "uint32": "<u4",
    "float": "<f4",
    "float32": "<f4",
    "double": "<f8",
    "float64": "<f8",
}
Element = tuple[str, int, list[list[str]]]  # element name, count, words of its properties


def read_mesh(path: Path) -> Occluders:
    """Read the triangles of a mesh file.

    Raises:
        DataError: naming the file, if it is not a PLY or OBJ mesh that can be read.
    """
    data = read_bytes(path, largest_document())
    try:
        vertices, faces = _ply(data) if path.suffix.lower() == ".ply" else _obj(data.decode())
        triangles = [(face[0], a, b) for face in faces for a, b in pairwise(face[1:])]
        things = Occluders(vertices.reshape(-1, 3), np.array(triangles, np.int64).reshape(-1, 3))
    except EnvironmentProblem:
        raise
    except Exception as error:  # a parser of arbitrary content can raise any exception
        detail = "it ends too early" if isinstance(error, StopIteration) else one_line(error)
        raise DataError(
            f"{path} is not a mesh that can be read ({detail}); export it as a text PLY"
        ) from None
    if not len(things.triangles):
        raise DataError(f"{path} has no faces; a point cloud hides nothing")
    return things


def _obj(text: str) -> tuple[Array, list[Sequence[int]]]:
    vertices: list[list[float]] = []
    faces: list[Sequence[int]] = []
    for line in text.splitlines():
        words = line.split()
        if words[:1] == ["v"]:
            vertices.append([float(word) for word in words[1:4]])
        elif words[:1] == ["f"]:
            numbers = [int(word.split("/")[0]) for word in words[1:]]
            faces.append([n - 1 if n > 0 else len(vertices) + n for n in numbers])
    return np.array(vertices, np.float64), faces


def _ply(data: bytes) -> tuple[Array, list[Sequence[int]]]:
    head, mark, body = data.partition(b"end_header")
    lines = [line.split() for line in head.decode("ascii").splitlines()]
    if lines[:1] != [["ply"]] or not mark:
        raise ValueError("no PLY header")
    kind = next(words[1] for words in lines if words[:1] == ["format"])
    if kind not in ("ascii", "binary_little_endian"):
        raise ValueError(f"format {kind}")
    body = body[body.index(b"\n") + 1 :]
    elements = _elements(lines)
    return _ply_text(body.decode("ascii"), elements) if kind == "ascii" else _ply_binary(body, elements)


def _elements(lines: list[list[str]]) -> list[Element]:
    elements: list[Element] = []
    for words in lines:
        if words[:1] == ["element"]:
            elements.append((words[1], int(words[2]), []))
        elif words[:1] == ["property"]:
            elements[-1][2].append(words[1:])
    return elements


def _places(properties: list[list[str]]) -> list[int]:
    names = [words[-1] for words in properties]
    return [names.index(axis) for axis in "xyz"]


def _ply_text(text: str, elements: list[Element]) -> tuple[Array, list[Sequence[int]]]:
    rows = iter(text.splitlines())
    vertices = np.zeros((0, 3))
    faces: list[Sequence[int]] = []
    for name, count, properties in elements:
        table = [next(rows).split() for _ in range(count)]
        if name == "vertex":
            places = _places(properties)
            vertices = np.array([[row[k] for k in places] for row in table], np.float64)
        elif name == "face":
            _check_face(properties)
            faces = [[int(word) for word in row[1 : 1 + int(row[0])]] for row in table]
    return vertices, faces


def _ply_binary(body: bytes, elements: list[Element]) -> tuple[Array, list[Sequence[int]]]:
    at = 0
    vertices = np.zeros((0, 3))
    faces: list[Sequence[int]] = []
    for name, count, properties in elements:
        if name == "face":
            _check_face(properties)
            _, length, index = properties[0][:3]
            for _ in range(count):
                size = int(np.frombuffer(body, _TYPES[length], 1, at)[0])
                at += np.dtype(_TYPES[length]).itemsize
                faces.append(np.frombuffer(body, _TYPES[index], size, at).tolist())
                at += size * np.dtype(_TYPES[index]).itemsize
                at += sum(np.dtype(_TYPES[kind]).itemsize for kind, _ in properties[1:])
        else:
            row = np.dtype([(words[-1], _TYPES[words[0]]) for words in properties])
            table = np.frombuffer(body, row, count, at)
            at += count * row.itemsize
            if name == "vertex":
                vertices = np.stack([table[axis].astype(np.float64) for axis in "xyz"], axis=-1)
    return vertices, faces


def _check_face(properties: list[list[str]]) -> None:
    if properties[0][0] != "list":
        raise ValueError("faces do not begin with the list of their vertices")
