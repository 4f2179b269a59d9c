"""Write bodies as BVH (Biovision hierarchy), including the rotation of segments about their own axes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.domain.subjects import BodyState
from panoptic_ros.export.resampled import local_turns, motion_of
from panoptic_ros.geometry.euler import euler_angles

Array = np.ndarray
UNIT = 100.0  # file units per metre: cm, as usual in BVH
FILE_FROM_WORLD = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])  # y up, z forward
ORDER = "zxy"
CHANNELS = "Zrotation Xrotation Yrotation"
LEAF = 0.5  # length of a segment without children, as a fraction of its parent's


def bvh_text(model: SegmentModel, states: Sequence[BodyState]) -> str:
    """Return the file of one person.

    y is up and z forward, lengths are in cm, angles in degrees. The pose without rotations is a T-pose facing
    forward. Frames have a fixed rate; a missing body is replaced by the previous one.

    Args:
        model: segment skeleton of the bodies.
        states: bodies of one person in order of time.

    Raises:
        DataError: if there are fewer than two frames.
    """
    motion = motion_of(model, states, "BVH")
    count, offsets = len(motion.places), motion.offsets
    turns = local_turns(model, motion.frames)
    turned = FILE_FROM_WORLD @ turns @ FILE_FROM_WORLD.T
    angles = np.degrees(euler_angles(turned, ORDER))
    order = _depth_first(model)
    roots = UNIT * motion.places[:, 0] @ FILE_FROM_WORLD.T
    table = np.concatenate([roots, angles[:, order].reshape(count, -1)], axis=1)
    lines = ["HIERARCHY", *_joint(model, UNIT * offsets @ FILE_FROM_WORLD.T, 0, 0)]
    lines += ["MOTION", f"Frames: {count}", f"Frame Time: {motion.period:.9f}"]
    lines += [" ".join(f"{value:.4f}" for value in row) for row in table]
    return "\n".join(lines) + "\n"


def _children(model: SegmentModel, segment: int) -> list[int]:
    return [k for k, parent in enumerate(model.parents.tolist()) if parent == segment]


def _depth_first(model: SegmentModel, segment: int = 0) -> list[int]:
    """Return the segments in the order of the file."""
    return [segment, *(s for child in _children(model, segment) for s in _depth_first(model, child))]


def _joint(model: SegmentModel, offsets: Array, segment: int, depth: int) -> list[str]:
    """Return the lines of a segment and its descendants; offsets (S, 3) are in the axes of the file."""
    pad, root = "  " * depth, segment == 0
    offset = np.zeros(3) if root else offsets[segment]
    channels = f"6 Xposition Yposition Zposition {CHANNELS}" if root else f"3 {CHANNELS}"
    lines = [
        f"{pad}{'ROOT' if root else 'JOINT'} {model.names[segment]}",
        f"{pad}{{",
        f"{pad}  OFFSET {_numbers(offset)}",
        f"{pad}  CHANNELS {channels}",
    ]
    below = _children(model, segment)
    for child in below:
        lines += _joint(model, offsets, child, depth + 1)
    if not below:
        end = f"{pad}    OFFSET {_numbers(LEAF * offset)}"
        lines += [f"{pad}  End Site", f"{pad}  {{", end, f"{pad}  }}"]
    return [*lines, f"{pad}}}"]


def _numbers(values: Array) -> str:
    return " ".join(f"{value:.5f}" for value in values)
