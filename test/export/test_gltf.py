"""glTF: what the file's nodes and animation say is where the segments are."""

import json
import struct

import numpy as np
import pytest
from bodies import MODEL, placed, some_pose

from panoptic_ros.domain.subjects import BodyState
from panoptic_ros.errors import DataError
from panoptic_ros.export.gltf import glb_bytes
from panoptic_ros.io.body_models import read_body_shape

TYPES = {5126: np.dtype("<f4"), 5123: np.dtype("<u2")}
WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}


def states(number, begin=0, count=4):
    found = []
    for k in range(count):
        frames, places = placed(some_pose(10 * number + k))
        found.append(BodyState(begin + 20_000_000 * k, number, places, frames))
    return found


def read(data):
    """The document of a GLB and a function that gives the values of an accessor, by the specification."""
    magic, version, length = struct.unpack_from("<III", data)
    assert (magic, version, length) == (0x46546C67, 2, len(data)) and length % 4 == 0
    size, kind = struct.unpack_from("<II", data, 12)
    assert kind == 0x4E4F534A and size % 4 == 0
    document = json.loads(data[20 : 20 + size])
    binary_size, kind = struct.unpack_from("<II", data, 20 + size)
    assert kind == 0x004E4942 and binary_size == document["buffers"][0]["byteLength"]
    binary = data[28 + size :]

    def values(index):
        accessor = document["accessors"][index]
        view = document["bufferViews"][accessor["bufferView"]]
        dtype, width = TYPES[accessor["componentType"]], WIDTHS[accessor["type"]]
        assert view["byteOffset"] % 4 == 0
        flat = np.frombuffer(binary, dtype, accessor["count"] * width, view["byteOffset"])
        assert flat.nbytes == view["byteLength"]
        return flat.reshape(accessor["count"], width)

    return document, values


def matrix(translation, rotation):
    x, y, z, w = rotation
    found = np.eye(4)
    found[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    found[:3, 3] = translation
    return found


def world_of(document, values, instant):
    """World matrices of all nodes at a key of the animation."""
    nodes = [dict(node) for node in document["nodes"]]
    (animation,) = document["animations"]
    for channel in animation["channels"]:
        sampler = animation["samplers"][channel["sampler"]]
        keys = values(sampler["output"])
        nodes[channel["target"]["node"]][channel["target"]["path"]] = keys[min(instant, len(keys) - 1)]
    found = {}

    def walk(index, above):
        node = nodes[index]
        own = matrix(node.get("translation", (0, 0, 0)), node.get("rotation", (0, 0, 0, 1)))
        found[node["name"]] = above @ own
        for child in node.get("children", ()):
            walk(child, found[node["name"]])

    walk(document["scenes"][0]["nodes"][0], np.eye(4))
    return found


def test_nodes_stand_where_segments_are_with_y_up():
    people = {3: states(3), 4: states(4, begin=10_000_000)}
    shape = read_body_shape(MODEL)
    document, values = read(glb_bytes(shape, people, {3: (1, 0, 0), 4: (0, 1, 0)}))
    up = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])  # x forward, y up, z right
    for instant in range(4):
        found = world_of(document, values, instant)
        for number, own in people.items():
            for s, name in enumerate(MODEL.names):
                node = found[f"{name}_p{number}"]
                assert node[:3, 3] == pytest.approx(up @ own[instant].places[s], abs=1e-6)
                assert node[:3, :3] == pytest.approx(up @ own[instant].frames[s], abs=1e-5)
    times = [values(s["input"])[:, 0] for s in document["animations"][0]["samplers"]]
    assert times[0] == pytest.approx([0, 0.02, 0.04, 0.06]) and times[-1][0] == pytest.approx(0.01)


def test_every_segment_has_a_closed_surface_round_its_bone():
    document, values = read(glb_bytes(read_body_shape(MODEL), {3: states(3)}, {3: (1, 0, 0)}))
    assert {mesh["name"] for mesh in document["meshes"]} == {f"{name}_p3" for name in MODEL.names}
    for mesh in document["meshes"]:
        (part,) = mesh["primitives"]
        points, corners = values(part["attributes"]["POSITION"]), values(part["indices"]).reshape(-1, 3)
        accessor = document["accessors"][part["attributes"]["POSITION"]]
        assert accessor["min"] == pytest.approx(points.min(0)) and corners.max() < len(points)
        normals = values(part["attributes"]["NORMAL"])
        assert np.linalg.norm(normals, axis=1) == pytest.approx(1, abs=1e-5)
        a, b, c = points[corners].swapaxes(0, 1).astype(float)
        volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6
        assert volume > 1e-5  # counter-clockwise from outside, closed


def test_one_instant_is_no_motion():
    with pytest.raises(DataError, match="glTF needs two instants"):
        glb_bytes(read_body_shape(MODEL), {3: states(3, count=1)}, {3: (1, 0, 0)})
