"""Offsets of a detector's joints in the frames of body segments.

After Malleson et al. 2020, 3.3.2, the offsets are per-axis medians over all frames, in metres in a segment's
frame, mirrored between the sides. A joint lies where two segments meet. Its offset is expressed in the frame
of the segment in which it varies less. The offset depends on the detector AND on the joint definition of the
reference. So it is measured on some people and evaluated on others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain.segments import JointOffset, SegmentModel
from panoptic_ros.evaluation.bias import Benefit, scores_of

Array = np.ndarray
FEWEST = 10  # smallest number of observations of a joint


class MatchedSkeletons(NamedTuple):
    """M detected skeletons with their ground truth.

    Args:
        ids: Truth ids (M,).
        truth: True joints (M, J, 3) m.
        seen: Detected joints (M, J, 3) m.
        frames: Segment rotations (M, S, 3, 3) of the bodies, world from segment.
    """

    ids: Array
    truth: Array
    seen: Array
    frames: Array

    def rows(self, which: Array) -> MatchedSkeletons:
        """Return the rows selected by an index or mask."""
        return MatchedSkeletons(*(values[which] for values in self))


class SegmentOffset(NamedTuple):
    """Offset of a joint in the frame of one segment.

    Args:
        frame: Name of the segment.
        offset: Median offset (3,) m.
        spread: Mean distance of the observations from it, m.
    """

    frame: str
    offset: Array
    spread: float


def measure_joint_offsets(
    people: MatchedSkeletons, joint_names: Sequence[str], model: SegmentModel
) -> dict[str, JointOffset]:
    """Return the offsets by joint name, for all joints observed in enough frames on both sides together."""
    columns = {name: j for j, name in enumerate(joint_names)}
    found: dict[str, JointOffset] = {}
    for name in model.keypoints:
        if name not in columns or name in found:
            continue
        other = _other(name, model.keypoints)
        kept = []
        for frame in (model.names[k] for k in model.frames_of(name)):
            looks = [_looks(people, columns[name], model.index(frame))]
            if other in columns and other != name:
                mirror = _looks(people, columns[other], model.index(_other(frame, model.names)))
                looks.append(mirror * (1.0, -1.0, 1.0))
            values = np.concatenate(looks)
            values = values[np.isfinite(values).all(-1)]
            if len(values) >= FEWEST:
                middle = np.median(values, axis=0)
                kept.append(
                    SegmentOffset(frame, middle, float(np.linalg.norm(values - middle, axis=-1).mean()))
                )
        if not kept:
            continue
        best = min(kept, key=lambda found: found.spread)
        x, y, z = best.offset.tolist()
        if other == name:
            y = 0.0
        found[name] = JointOffset(best.frame, (x, y, z))
        if other in columns and other != name:
            found[other] = JointOffset(_other(best.frame, model.names), (x, -y, z))
    return found


def corrected_joints(
    people: MatchedSkeletons,
    joint_names: Sequence[str],
    model: SegmentModel,
    offsets: Mapping[str, JointOffset],
) -> Array:
    """Return the detected joints (M, J, 3) m with these offsets removed."""
    found = people.seen.copy()
    for j, name in enumerate(joint_names):
        if name in offsets:
            found[:, j] -= people.frames[:, model.index(offsets[name].frame)] @ np.array(offsets[name].offset)
    return found


def judge_joint_offsets(
    people: MatchedSkeletons, joint_names: Sequence[str], model: SegmentModel
) -> tuple[Benefit, ...]:
    """Return each person's benefit from the offsets measured on all others.

    The tuple is empty with only one person.
    """
    persons = np.unique(people.ids).tolist()
    found = []
    for person in persons if len(persons) > 1 else ():
        own = people.rows(people.ids == person)
        offsets = measure_joint_offsets(people.rows(people.ids != person), joint_names, model)
        after = corrected_joints(own, joint_names, model, offsets)
        found.append(Benefit(int(person), *scores_of(own.truth, own.seen, after)))
    return tuple(found)


def _looks(people: MatchedSkeletons, joint: int, segment: int) -> Array:
    """Return the offsets (M, 3) m of a detected joint from its true position, in a segment's frame."""
    apart = people.seen[:, joint] - people.truth[:, joint]
    found: Array = (people.frames[:, segment].swapaxes(1, 2) @ apart[..., None])[..., 0]
    return found


def _other(name: str, names: Sequence[str] | Mapping[str, object]) -> str:
    """Return the name on the other side, or the name itself on the midline."""
    other = {"l": "r", "r": "l"}.get(name[:1], "") + name[1:]
    return other if other in names else name
