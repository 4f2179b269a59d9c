"""First JSON document that a page receives: cameras, skeleton, topics, and their message definitions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from panoptic_ros.domain import Camera, Rig, SkeletonModel
from panoptic_ros.io.body_models import read_body_model, read_body_shape
from panoptic_ros.io.messages.family import bag_typestore


@dataclass(frozen=True)
class PageTopic:
    """Topic that a page can receive.

    Args:
        key: Key in `graph.topics.TOPICS`.
        owner: Camera, sensor or device of the topic, "" for a topic of the whole graph.
        message: ROS message type.
    """

    key: str
    owner: str
    message: str


@dataclass(frozen=True)
class SceneFacts:
    """Facts that stay constant while a page shows a scene.

    Args:
        kind: "live" or "recorded".
        title: Title for the reader.
        begin_ns, end_ns: Time range of a recording; 0 for a live scene.
        report: Parts of the run's report.json that a page shows; empty without a report.
        rates: Images per second by camera, where a page cannot count them.
    """

    kind: str
    title: str
    rig: Rig
    skeleton: SkeletonModel
    topics: Sequence[PageTopic]
    begin_ns: int = 0
    end_ns: int = 0
    report: Mapping[str, Any] = field(default_factory=dict)
    rates: Mapping[str, float] = field(default_factory=dict)

    def document(self) -> dict[str, Any]:
        """Return the facts as a JSON document, with integers that can exceed 2^53 as strings."""
        return {
            "type": "facts",
            "kind": self.kind,
            "title": self.title,
            "begin_ns": str(self.begin_ns),
            "end_ns": str(self.end_ns),
            "frame_id": self.rig.frame_id,
            "cameras": [camera_document(camera) for camera in self.rig.cameras],
            "skeleton": {
                "name": self.skeleton.name,
                "joints": list(self.skeleton.joint_names),
                "bones": [list(bone) for bone in self.skeleton.bones],
                "root": self.skeleton.root,
                "head": self.skeleton.head,
            },
            "topics": [[topic.key, topic.owner, topic.message] for topic in self.topics],
            "schemas": schemas(topic.message for topic in self.topics),
            "report": dict(self.report),
            "rates": dict(self.rates),
            "shape": shape_document() if any(topic.key == "bodies" for topic in self.topics) else None,
        }


def shape_document() -> dict[str, Any]:
    """Return the capsules of the body shape, which `bodies.js` draws."""
    model = read_body_model()

    def end(place: Any) -> Any:
        return model.names[place] if isinstance(place, int) else place.tolist()

    capsules = [
        {
            "segment": model.names[segment],
            "from": end(begin),
            "to": end(to),
            "radii": list(radii),
            "wide": wide,
        }
        for segment, begin, to, radii, wide in read_body_shape(model).rows
    ]
    return {"scale": float(np.linalg.norm(model.shares[1:], axis=1).sum()), "capsules": capsules}


def camera_document(camera: Camera) -> dict[str, Any]:
    """Return a camera with its full lens model, which `lens.js` uses for projection."""
    lens, pose = camera.intrinsics, camera.cam_from_world
    return {
        "name": camera.name,
        "size": list(camera.image_size),
        "lens": lens.lens,
        "matrix": lens.matrix.reshape(-1).tolist(),
        "distortion": lens.distortion.tolist(),
        "radius_limit": lens.radius_limit if math.isfinite(lens.radius_limit) else None,
        "rotation": pose.rotation.reshape(-1).tolist(),
        "translation": pose.translation.tolist(),
        "centre": camera.centre.tolist(),
        "type": camera.type,
        "panel": camera.panel,
        "clock": camera.clock,
    }


def schemas(kinds: Iterable[str]) -> dict[str, list[list[Any]]]:
    """Return definitions of message types and of their nested types: {type: [[field, type, count], ...]}.

    A count of -1 is a sequence, 0 is a single value, and any other number is an array of that length.
    """
    store, found = bag_typestore(), dict[str, list[list[Any]]]()
    waiting = list(kinds)
    while waiting:
        kind = waiting.pop()
        if kind in found:
            continue
        found[kind] = []
        for name, (node, detail) in store.fielddefs[kind][1]:
            inner, count = _field(int(node), detail)
            found[kind].append([name, inner, count])
            if "/" in inner:
                waiting.append(inner)
    return found


_BASE, _NAME, _ARRAY = 1, 2, 3  # node types of rosbags.interfaces.Nodetype


def _field(node: int, detail: Any) -> tuple[str, int]:
    if node == _BASE:
        return str(detail[0]), 0
    if node == _NAME:
        return str(detail), 0
    (inner, inner_detail), count = detail
    return _field(int(inner), inner_detail)[0], int(count) if node == _ARRAY else -1
