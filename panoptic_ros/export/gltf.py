"""Write bodies as an animated glTF 2.0 scene in one binary file (GLB): one node with a shape per segment."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from panoptic_ros.domain.body_shape import BodyShape
from panoptic_ros.domain.subjects import BodyState
from panoptic_ros.export.resampled import ResampledMotion, local_turns, motion_of
from panoptic_ros.geometry.capsules import capsule_mesh
from panoptic_ros.geometry.rotations import to_quaternions

Array = np.ndarray
Z_UP = [-(0.5**0.5), 0.0, 0.0, 0.5**0.5]  # quaternion x y z w from z up (world) to y up (glTF)
FLOAT, SHORT = 5126, 5123  # component types of glTF
ARRAY, ELEMENTS = 34962, 34963  # targets of buffer views
MAGIC, JSON_CHUNK, BINARY_CHUNK = 0x46546C67, 0x4E4F534A, 0x004E4942


class _Buffer:
    """Binary buffer of concatenated arrays, with their views and accessors."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(self, values: Array, kind: str, target: int | None = None, bounds: bool = False) -> int:
        """Append an array (N, ...) of float32 or uint16 and return the index of its accessor.

        Args:
            kind: element type of glTF, e.g. "VEC3".
            target: target of the buffer view, if any.
            bounds: state the minimum and maximum.
        """
        short = values.dtype == np.uint16
        self.data.extend(b"\0" * (-len(self.data) % 4))
        view: dict[str, Any] = {"buffer": 0, "byteOffset": len(self.data), "byteLength": values.nbytes}
        self.views.append(view if target is None else {**view, "target": target})
        self.data += np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<")).tobytes()
        accessor: dict[str, Any] = {
            "bufferView": len(self.views) - 1,
            "componentType": SHORT if short else FLOAT,
            "count": len(values),
            "type": kind,
        }
        if bounds:
            rows = values.reshape(len(values), -1)
            accessor |= {"min": rows.min(0).tolist(), "max": rows.max(0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def glb_bytes(
    shape: BodyShape,
    people: Mapping[int, Sequence[BodyState]],
    colours: Mapping[int, tuple[float, float, float]],
) -> bytes:
    """Return the file: metres, y up (x forward as in the world), with the animation "motion" from 0 s on.

    Args:
        people: bodies in order of time, by person id.
        colours: red, green, blue, 0 to 1, by person id.

    Raises:
        DataError: if a person has fewer than two frames.
    """
    motions = {number: motion_of(shape.model, own, "glTF") for number, own in people.items()}
    first = min(motion.first_ns for motion in motions.values())
    buffer = _Buffer()
    world: dict[str, Any] = {"name": "world", "rotation": Z_UP, "children": []}
    nodes, meshes, materials = [world], list[dict[str, Any]](), list[dict[str, Any]]()
    channels, samplers = list[dict[str, Any]](), list[dict[str, Any]]()
    for number, motion in motions.items():
        surface = {"baseColorFactor": [*colours[number], 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.8}
        materials.append({"name": f"p{number}", "pbrMetallicRoughness": surface})
        root = len(nodes)
        world["children"].append(root)
        nodes += _segments(shape, motion, buffer, meshes, len(materials) - 1, number, root)
        times = 1e-9 * (motion.first_ns - first) + motion.period * np.arange(len(motion.places))
        stamps = buffer.add(times.astype(np.float32), "SCALAR", bounds=True)
        turns = _smooth(to_quaternions(local_turns(shape.model, motion.frames).reshape(-1, 3, 3)), motion)
        tracks = [("translation", root, motion.places[:, 0], "VEC3")]
        tracks += [("rotation", root + s, turns[:, s], "VEC4") for s in range(len(shape.model.names))]
        for path, node, values, kind in tracks:
            output = buffer.add(values.astype(np.float32), kind)
            samplers.append({"input": stamps, "output": output, "interpolation": "LINEAR"})
            channels.append({"sampler": len(samplers) - 1, "target": {"node": node, "path": path}})
    buffer.data.extend(b"\0" * (-len(buffer.data) % 4))
    document = {
        "asset": {"version": "2.0", "generator": "panoptic_ros"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": nodes,
        "meshes": meshes,
        "materials": materials,
        "animations": [{"name": "motion", "channels": channels, "samplers": samplers}],
        "buffers": [{"byteLength": len(buffer.data)}],
        "bufferViews": buffer.views,
        "accessors": buffer.accessors,
    }
    return _packed(document, bytes(buffer.data))


def _segments(
    shape: BodyShape,
    motion: ResampledMotion,
    buffer: _Buffer,
    meshes: list[dict[str, Any]],
    material: int,
    number: int,
    root: int,
) -> list[dict[str, Any]]:
    """Return the nodes of all segments of a person, in the pose of the first frame."""
    model = shape.model
    found = []
    for s, name in enumerate(model.names):
        node: dict[str, Any] = {"name": f"{name}_p{number}", "translation": motion.offsets[s].tolist()}
        children = [root + k for k, parent in enumerate(model.parents.tolist()) if parent == s]
        found.append(node | ({"children": children} if children else {}))
    found[0]["translation"] = motion.places[0, 0].tolist()
    surfaces: dict[int, list[tuple[Array, Array, Array]]] = {}
    for capsule in shape.capsules(motion.offsets):
        mesh = capsule_mesh(capsule.begin, capsule.end, capsule.radii, capsule.wide)
        surfaces.setdefault(capsule.segment, []).append(mesh)
    for segment, parts in surfaces.items():
        starts = np.cumsum([0, *(len(vertices) for vertices, _, _ in parts[:-1])])
        vertices, normals = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
        corners = np.concatenate([part[2] + start for part, start in zip(parts, starts)]).reshape(-1)
        primitive = {
            "attributes": {
                "POSITION": buffer.add(vertices.astype(np.float32), "VEC3", ARRAY, bounds=True),
                "NORMAL": buffer.add(normals.astype(np.float32), "VEC3", ARRAY),
            },
            "indices": buffer.add(corners.astype(np.uint16), "SCALAR", ELEMENTS),
            "material": material,
        }
        found[segment]["mesh"] = len(meshes)
        meshes.append({"name": found[segment]["name"], "primitives": [primitive]})
    return found


def _smooth(quaternions: Array, motion: ResampledMotion) -> Array:
    """Convert quaternions w x y z to x y z w (N, S, 4) without sign changes between successive frames."""
    rows = quaternions.reshape(*motion.frames.shape[:2], 4)[..., [1, 2, 3, 0]]
    signs = np.where((rows[1:] * rows[:-1]).sum(-1) < 0.0, -1.0, 1.0)
    rows[1:] *= np.cumprod(signs, axis=0)[..., None]
    return rows


def _packed(document: Mapping[str, Any], data: bytes) -> bytes:
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<III", MAGIC, 2, 12 + 8 + len(text) + 8 + len(data))
    chunks = struct.pack("<II", len(text), JSON_CHUNK) + text + struct.pack("<II", len(data), BINARY_CHUNK)
    return head + chunks + data
