"""Where a detector sees joints, in the frames of the segments of a body.

Malleson et al. 2020, 3.3.2: per-axis medians over all frames, in metres in the frame of a segment, the same
on both sides. A joint sits where two segments meet: its offset is taken in the frame of the one that it
varies less in. It is a property of the detector AND of what the reference calls a joint; so it is measured on
some people and judged on others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain.segments import JointOffset, SegmentModel
from panoptic_ros.evaluation.bias import Benefit, scores_of

Array = np.ndarray
FEWEST = 10  # looks at a joint


class PosedPeople(NamedTuple):
    """M skeletons with what is true of them: ids (M,) of the truth; joints of the truth and of the detector
    (M, J, 3) m; frames (M, S, 3, 3) of their bodies, world from segment."""

    ids: Array
    truth: Array
    seen: Array
    frames: Array

    def rows(self, which: Array) -> PosedPeople:
        """Some of them."""
        return PosedPeople(*(values[which] for values in self))


class Kept(NamedTuple):
    """A joint's offset m in the frame of a segment, and how far looks are off it in the mean, m."""

    frame: str
    offset: Array
    spread: float


def measure_joint_offsets(
    people: PosedPeople, joint_names: Sequence[str], model: SegmentModel
) -> dict[str, JointOffset]:
    """Offsets of the joints of both sides that are seen in enough frames, by their names."""
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
                kept.append(Kept(frame, middle, float(np.linalg.norm(values - middle, axis=-1).mean())))
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
    people: PosedPeople, joint_names: Sequence[str], model: SegmentModel, offsets: Mapping[str, JointOffset]
) -> Array:
    """The detector's joints (M, J, 3) m with these offsets taken out."""
    found = people.seen.copy()
    for j, name in enumerate(joint_names):
        if name in offsets:
            found[:, j] -= people.frames[:, model.index(offsets[name].frame)] @ np.array(offsets[name].offset)
    return found


def judge_joint_offsets(
    people: PosedPeople, joint_names: Sequence[str], model: SegmentModel
) -> tuple[Benefit, ...]:
    """For every person, what the offsets measured on all others are worth; nothing for one person alone."""
    persons = np.unique(people.ids).tolist()
    found = []
    for person in persons if len(persons) > 1 else ():
        own = people.rows(people.ids == person)
        offsets = measure_joint_offsets(people.rows(people.ids != person), joint_names, model)
        after = corrected_joints(own, joint_names, model, offsets)
        found.append(Benefit(int(person), *scores_of(own.truth, own.seen, after)))
    return tuple(found)


def _looks(people: PosedPeople, joint: int, segment: int) -> Array:
    """How far off the truth the detector sees a joint (M, 3) m, in the frames of a segment."""
    apart = people.seen[:, joint] - people.truth[:, joint]
    found: Array = (people.frames[:, segment].swapaxes(1, 2) @ apart[..., None])[..., 0]
    return found


def _other(name: str, names: Sequence[str] | Mapping[str, object]) -> str:
    """What is on the other side; itself in the middle."""
    other = {"l": "r", "r": "l"}.get(name[:1], "") + name[1:]
    return other if other in names else name
