"""Convert bodies to JSON for programs that animate figures, e.g. game engines."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from panoptic_ros.domain import BodySource, BodyStateSet
from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.geometry.rotations import from_quaternions, to_quaternions

Array = np.ndarray
FORMAT = "panoptic-bodies-stream-1"


def hello_text(model: SegmentModel, frame_id: str) -> str:
    """Return the first message for a client: segment names and parents, joint angle names, world frame."""
    return _text(
        {
            "format": FORMAT,
            "frame_id": frame_id,
            "segments": list(model.names),
            "parents": model.parents.tolist(),
            "joint_names": list(model.joint_names),
        }
    )


def instant_text(item: BodyStateSet, model: SegmentModel) -> str:
    """Return the bodies of one frame as JSON: m, right-handed, z up; quaternions x y z w.

    Each subject has:

    - `root`: position in the world
    - `rotations`: of segments in their parents' frames, of the first in the world
    - `offsets`: of joints in their parents' frames
    - `positions`: of joints in the world
    - `joint_angles`: rad
    - `source`: see `BodySource`
    """
    seconds, rest = divmod(item.stamp_ns, 1_000_000_000)
    subjects = []
    for k, number in enumerate(item.ids.tolist()):
        frames = from_quaternions(item.orientations[k])
        turns = frames[model.parents].swapaxes(-1, -2) @ frames
        turns[0] = frames[0]
        subjects.append(
            {
                "id": number,
                "source": BodySource(int(item.sources[k])).name,
                "root": _rounded(item.positions[k, 0]),
                "rotations": _rounded(to_quaternions(turns)[:, [1, 2, 3, 0]], 6),
                "offsets": _rounded(item.offsets[k]),
                "positions": _rounded(item.positions[k]),
                "joint_angles": _rounded(model.joint_angles(frames)),
            }
        )
    return _text({"index": item.index, "stamp": {"sec": seconds, "nanosec": rest}, "subjects": subjects})


def _rounded(values: Array, digits: int = 5) -> Any:
    return np.round(values, digits).tolist()


def _text(document: Any) -> str:
    return json.dumps(document, separators=(",", ":"))
