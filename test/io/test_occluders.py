"""Boxes and meshes come out as written down, and what is wrong is named."""

import json
import struct

import numpy as np
import pytest

from panoptic_ros.domain import Occluders
from panoptic_ros.errors import DataError
from panoptic_ros.io.occluders import read_occluders, write_occluders

SQUARE = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 2.0, 0.0], [0.0, 2.0, 0.5]])
PLY = "ply\nformat {}\ncomment made by hand\nelement vertex 4\nproperty float x\nproperty float y\n" + (
    "property float z\nproperty uchar red\nelement face 1\n"
    "property list uchar int vertex_indices\nend_header\n"
)


def areas(things):
    a, b, c = things.vertices[things.triangles].swapaxes(0, 1)
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


def document(tmp_path, **content):
    path = tmp_path / "occluders.json"
    path.write_text(json.dumps({"format": "panoptic-occluders-1", "units": "m", **content}))
    return path


def test_a_box_has_its_sides_where_it_was_put(tmp_path):
    turned = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]  # its x axis is the world's y axis
    box = {"name": "wall", "size": [4.0, 0.2, 2.5], "centre": [1.0, 2.0, 1.25], "R": turned}
    things = read_occluders(document(tmp_path, boxes=[box]))
    assert things.vertices.min(0) == pytest.approx([0.9, 0.0, 0.0])
    assert things.vertices.max(0) == pytest.approx([1.1, 4.0, 2.5])
    assert areas(things).sum() == pytest.approx(2 * (4 * 0.2 + 4 * 2.5 + 0.2 * 2.5))


def test_round_trip_is_exact(tmp_path):
    things = Occluders(np.random.default_rng(0).normal(size=(5, 3)), [[0, 1, 2], [2, 3, 4]])
    write_occluders(tmp_path / "o.json", things)
    back = read_occluders(tmp_path / "o.json")
    assert np.array_equal(back.vertices, things.vertices)
    assert np.array_equal(back.triangles, things.triangles)


def meshes(folder):
    rows = [" ".join(map(str, p)) for p in SQUARE]
    (folder / "text.ply").write_text(
        PLY.format("ascii 1.0") + "\n".join(f"{row} 7" for row in rows) + "\n4 0 1 2 3\n"
    )
    body = b"".join(struct.pack("<3fB", *p, 7) for p in SQUARE) + struct.pack("<B4i", 4, 0, 1, 2, 3)
    (folder / "binary.ply").write_bytes(PLY.format("binary_little_endian 1.0").encode() + body)
    faces = "# a square\n" + "\n".join(f"v {row}" for row in rows)
    (folder / "square.obj").write_text(faces + "\nvt 0 0\nf 1/1 2/1 3/1 4/1\n")
    (folder / "ends.obj").write_text(faces + "\nf -4 -3 -2 -1\n")
    return ["text.ply", "binary.ply", "square.obj", "ends.obj"]


def test_every_kind_of_mesh_is_the_same_square(tmp_path):
    for name in meshes(tmp_path):
        things = read_occluders(tmp_path / name)
        assert things.vertices == pytest.approx(SQUARE)
        assert things.triangles.tolist() == [[0, 1, 2], [0, 2, 3]]
    both = read_occluders(document(tmp_path, meshes=[{"file": "text.ply"}, {"file": "square.obj"}]))
    assert both.triangles.tolist() == [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]


@pytest.mark.parametrize(
    "content, words",
    [
        ({}, "neither boxes nor meshes"),
        ({"units": "cm"}, "'cm'"),
        ({"format": "x"}, "format 'x'"),
        ({"boxes": {}}, "boxes is not a list"),
        ({"boxes": [{"name": "pillar", "size": [1, 1, 1]}]}, "box pillar has no 'centre'"),
        ({"boxes": [{"size": [1, 1], "centre": [0, 0, 0]}]}, "box number 0: size must be 3 finite numbers"),
        ({"boxes": [{"size": [1, -1, 1], "centre": [0, 0, 0]}]}, "negative edge"),
        ({"boxes": [{"size": [1, 1, "a"], "centre": [0, 0, 0]}]}, "size has something that is not a number"),
        (
            {"boxes": [{"size": [1, 1, 1], "centre": [0, 0, 0], "R": np.ones((3, 3)).tolist()}]},
            "not a rotation",
        ),
        ({"meshes": [{"vertices": [[0, 0, 0]], "triangles": [[0, 0, 1]]}]}, "mesh number 0: .* among the 1"),
        ({"meshes": [{"file": "not_there.ply"}]}, "not_there.ply"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, content, words):
    with pytest.raises(DataError, match=words):
        read_occluders(document(tmp_path, **content))


@pytest.mark.parametrize(
    "name, data, words",
    [
        ("a.ply", b"not a mesh", "no PLY header"),
        ("a.ply", PLY.format("binary_big_endian 1.0").encode(), "binary_big_endian"),
        ("a.ply", PLY.format("ascii 1.0").encode() + b"0 0 0 7\n", "ends too early"),
        ("a.ply", PLY.format("binary_little_endian 1.0").encode() + b"\0" * 20, "buffer"),
        ("a.obj", b"v 0 0 0\nv 0 0 1\nv 0 1 0\nf 1 2 9\n", "not among the 3"),
        ("a.obj", b"v 0 0 0\nv 0 0 1\nv 0 1 0\n", "no faces"),
        ("a.json", b"[1, 2", "not valid JSON"),
    ],
)
def test_broken_files_are_refused_in_one_line(tmp_path, name, data, words):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(DataError, match=words) as error:
        read_occluders(tmp_path / name)
    assert "\n" not in str(error.value) and name in str(error.value)
