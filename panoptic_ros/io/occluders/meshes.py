"""Triangle meshes: PLY (text, little-endian binary) and Wavefront OBJ."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from panoptic_ros.domain import Occluders
from panoptic_ros.errors import DataError, EnvironmentProblem, one_line
from panoptic_ros.io.loading import largest_document, read_bytes

Array = np.ndarray
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
Element = tuple[str, int, list[list[str]]]  # name, count, the words of its properties


def read_mesh(path: Path) -> Occluders:
    """The triangles of a file.

    Raises:
        DataError: naming the file, if it is no mesh of these formats.
    """
    data = read_bytes(path, largest_document())
    try:
        vertices, faces = _ply(data) if path.suffix.lower() == ".ply" else _obj(data.decode())
        triangles = [(face[0], a, b) for face in faces for a, b in pairwise(face[1:])]
        things = Occluders(vertices.reshape(-1, 3), np.array(triangles, np.int64).reshape(-1, 3))
    except EnvironmentProblem:
        raise
    except Exception as error:  # a parser of any content raises anything
        detail = "it ends too early" if isinstance(error, StopIteration) else one_line(error)
        raise DataError(f"{path} is no mesh that can be read ({detail}); export it as a text PLY") from None
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
