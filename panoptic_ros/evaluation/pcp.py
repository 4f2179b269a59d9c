"""Percentage of correct parts (PCP) on the Shelf and Campus annotation, by two published rules.

A limb is correct if the mean error of its two ends is at most half of its true length (Belagiannis et al.
2014). There are ten limbs: upper and lower arms and legs, head (bottom to top), torso (mid hip to bottom of
the head). Actors that are not annotated in a frame do not count there.

voxelpose: every annotated actor gets the nearest estimate (mean distance over the 14 joints).
    One estimate may serve two actors, so ghosts cost nothing.
4d-association: estimates are assigned one to one on the summed distance over 15 joints (mid hip added).
    An actor without an estimate is left out of the count.

Published numbers are the mean over actors 1 to 3 in frames 300 to 600. The rules assume complete skeletons.
Here a limb with a missing end is wrong, and distances are taken over the joints that are present. One ear
stands for both if the other is missing.

The 14 annotation joints are derived from the joints of a detector. The annotation marks the bottom and the
top of the head, which no common detector reports. Each protocol derives them differently from nose, ears and
shoulders, and this choice changes its numbers by points.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from panoptic_ros.errors import DataError
from panoptic_ros.evaluation.pairing import distance_table, nearest_frames
from panoptic_ros.evaluation.sequences import SkeletonSequence

ANNOTATION_JOINTS = (
    "right_ankle",
    "right_knee",
    "right_hip",
    "left_hip",
    "left_knee",
    "left_ankle",
    "right_wrist",
    "right_elbow",
    "right_shoulder",
    "left_shoulder",
    "left_elbow",
    "left_wrist",
    "bottom_head",
    "top_head",
)
BODY_JOINTS = ANNOTATION_JOINTS[:12]
UP = np.array([0.0, 0.0, 1.0])
Array = np.ndarray

PARTS = (
    ("right lower leg", "right_ankle", "right_knee"),
    ("right upper leg", "right_knee", "right_hip"),
    ("left upper leg", "left_hip", "left_knee"),
    ("left lower leg", "left_knee", "left_ankle"),
    ("right lower arm", "right_wrist", "right_elbow"),
    ("right upper arm", "right_elbow", "right_shoulder"),
    ("left upper arm", "left_shoulder", "left_elbow"),
    ("left lower arm", "left_elbow", "left_wrist"),
    ("head", "bottom_head", "top_head"),
    ("torso", "mid_hip", "bottom_head"),
)
JOINTS = (*ANNOTATION_JOINTS, "mid_hip")
ENDS = np.array([[JOINTS.index(a), JOINTS.index(b)] for _, a, b in PARTS])  # (10, 2)
FAR = 1e3  # m; cost of an estimate that shares no joint with an actor
AVERAGED_ACTORS = 3  # number of actors in published means, which leave out the last of four


def plain_name(name: str) -> str:
    """Return a joint's name in snake case, side first: lShoulder and LShoulder become left_shoulder."""
    sided = re.fullmatch(r"([lLrR])([A-Z][A-Za-z]*)", name)
    if sided:
        return ("left_" if sided[1] in "lL" else "right_") + sided[2].lower()
    return {"BodyCenter": "mid_hip", "MidHip": "mid_hip"}.get(name, name.lower())


class NamedJoints:
    """Joints (P, J, 3) m, accessed by their plain names; NaN where one is missing."""

    def __init__(self, joint_names: Sequence[str], positions: Array):
        self._columns = {plain_name(name): i for i, name in enumerate(joint_names)}
        self._positions = positions

    def __contains__(self, name: str) -> bool:
        return name in self._columns

    def __getitem__(self, name: str) -> Array:
        """Return positions (P, 3) m of a joint.

        Raises:
            DataError: If the skeletons have no such joint.
        """
        if name not in self._columns:
            raise DataError(f"PCP needs the joint {name}, which the result does not have")
        return self._positions[:, self._columns[name]]

    def middle(self, name: str) -> Array:
        """Return the mean (P, 3) of the left and right joint, or the other one where one is missing."""
        left, right = self["left_" + name], self["right_" + name]
        both = 0.5 * (left + right)
        return np.where(np.isnan(left), right, np.where(np.isnan(right), left, both))


def annotated_joints(joints: NamedJoints, head: Array) -> Array:
    """Return the 14 annotation joints (P, 14, 3) m; `head` (P, 2, 3) is the bottom and top of the head."""
    body = np.stack([joints[name] for name in BODY_JOINTS], axis=1)
    return np.concatenate([body, head], axis=1)


def head_of_voxelpose(joints: NamedJoints) -> Array:
    """Return bottom and top of the head (P, 2, 3) m as VoxelPose's evaluation defines them."""
    shoulders, ears, nose = joints.middle("shoulder"), joints.middle("ear"), joints["nose"]
    centre = 0.5 * (shoulders + ears)
    bottom = shoulders + 0.5 * (nose - shoulders)
    top = shoulders + np.array([0.75, 0.75, 1.5]) * (nose - shoulders)
    skull = centre + 2.0 * (ears - centre)
    return np.stack([0.75 * bottom + 0.25 * centre, 0.75 * top + 0.25 * skull], axis=1)


def head_of_association(joints: NamedJoints) -> Array:
    """Return bottom and top of the head (P, 2, 3) m as 4D Association's evaluation defines them."""
    shoulders, ears = joints.middle("shoulder"), joints.middle("ear")
    neck = joints["neck"] if "neck" in joints else shoulders
    hips = joints["mid_hip"] if "mid_hip" in joints else joints.middle("hip")
    across = joints["right_shoulder"] - joints["left_shoulder"]
    forward = np.cross(neck - hips, across)
    forward /= np.linalg.norm(forward, axis=-1, keepdims=True)
    bottom = shoulders + 0.5 * (ears - shoulders)
    return np.stack([bottom, bottom + 0.125 * forward + 0.145 * UP], axis=1)


@dataclass(frozen=True, slots=True)
class PcpRule:
    """PCP protocol: its name, its head definition, and its assignment."""

    name: str
    head: Callable[[NamedJoints], Array]
    exclusive: bool  # each estimate serves one actor, and actors without an estimate are ignored


PCP_RULES: dict[str, PcpRule] = {
    "pcp-voxelpose": PcpRule("voxelpose", head_of_voxelpose, exclusive=False),
    "pcp-4d-association": PcpRule("4d-association", head_of_association, exclusive=True),
}


@dataclass(frozen=True, slots=True)
class PcpReport:
    """PCP shares in 0..1, NaN where nothing counts.

    Args:
        rule: Name of the protocol.
        limbs: Limb names.
        actors: Number of each actor, from 1.
        poses: Number of poses that count, by actor.
        by_limb: Share per limb and actor.
        limb_means: Share per limb, averaged over those of the first three actors that have counted poses.
        by_actor: Share per actor, averaged over the ten limbs.
        mean: Mean of `by_actor` over those of the first three actors that have counted poses.
    """

    rule: str
    limbs: tuple[str, ...]
    actors: tuple[int, ...]
    poses: tuple[int, ...]
    by_limb: tuple[tuple[float, ...], ...]
    limb_means: tuple[float, ...]
    by_actor: tuple[float, ...]
    mean: float

    def to_mapping(self) -> dict[str, Any]:
        """Return the report for `--json`, in percent, with None where nothing counts."""

        def percent(share: float) -> float | None:
            return None if np.isnan(share) else 100.0 * share

        names = [f"actor{actor}" for actor in self.actors]
        return {
            "protocol": self.rule,
            "pcp": percent(self.mean),
            "pcp_by_actor": dict(zip(names, map(percent, self.by_actor))),
            "pcp_by_limb": dict(zip(self.limbs, map(percent, self.limb_means))),
            "poses": dict(zip(names, self.poses)),
        }


def evaluate_pcp(truth: SkeletonSequence, result: SkeletonSequence, protocol: str) -> PcpReport:
    """Return the PCP of a result; `protocol` is a key of `PCP_RULES`.

    The truth must have the 14 annotation joints and ids from 0 (actor 1). Frames are paired by timestamp.

    Raises:
        DataError: If a required joint is missing.
    """
    rule = PCP_RULES[protocol]
    annotated = _truth_joints(truth)
    stamps = (np.array([f.stamp_ns for f in s.frames], np.int64) for s in (truth, result))
    counts: dict[int, list[Array]] = {int(n): [] for frame in truth.frames for n in frame.ids}
    for frame, actors, partner in zip(truth.frames, annotated, nearest_frames(*stamps)):
        people = result.frames[partner].positions if partner is not None else None
        estimates = _estimates(rule, result.joint_names, people)
        for actor, pose in _assign(rule, actors, estimates):
            counts[int(frame.ids[actor])].append(right_limbs(actors[actor], pose))
    return _report(rule, counts)


def right_limbs(truth: Array, estimate: Array) -> Array:
    """Return a mask (10,) of correct limbs, for joints (15, 3) m of truth and estimate."""
    errors = np.linalg.norm(truth - estimate, axis=-1)
    lengths = np.linalg.norm(truth[ENDS[:, 0]] - truth[ENDS[:, 1]], axis=-1)
    right: Array = errors[ENDS].mean(axis=1) <= 0.5 * lengths  # NaN compares false
    return right


def _truth_joints(truth: SkeletonSequence) -> list[Array]:
    """Return the annotated joints (P, 15, 3) m of every frame."""
    columns = {plain_name(name): i for i, name in enumerate(truth.joint_names)}
    missing = [name for name in ANNOTATION_JOINTS if name not in columns]
    if missing:
        raise DataError(f"PCP needs an annotation of 14 joints; the truth has no {missing[0]}")
    order = [columns[name] for name in ANNOTATION_JOINTS]
    return [_with_hips(frame.positions[:, order]) for frame in truth.frames]


def _estimates(rule: PcpRule, joint_names: tuple[str, ...], people: Array | None) -> Array:
    """Return the estimated joints (P, 15, 3) m of one frame."""
    if people is None or not len(people):
        return np.empty((0, len(JOINTS), 3))
    joints = NamedJoints(joint_names, people)
    made = _with_hips(annotated_joints(joints, rule.head(joints)))
    if rule.exclusive and "mid_hip" in joints:
        made[:, -1] = joints["mid_hip"]
    return made


def _with_hips(joints: Array) -> Array:
    """Return the joints (P, 14, 3) extended by the middle of the hips: (P, 15, 3)."""
    right, left = JOINTS.index("right_hip"), JOINTS.index("left_hip")
    middle = 0.5 * (joints[:, right] + joints[:, left])
    return np.concatenate([joints, middle[:, None]], axis=1)


def _assign(rule: PcpRule, actors: Array, estimates: Array) -> list[tuple[int, Array]]:
    """Return (row of the actor, joints (15, 3) of its estimate) for every actor that counts."""
    nothing = np.full((len(JOINTS), 3), np.nan)
    if not len(actors):
        return []
    if not len(estimates):
        return [] if rule.exclusive else [(row, nothing) for row in range(len(actors))]
    used = slice(None) if rule.exclusive else slice(len(ANNOTATION_JOINTS))
    means = distance_table(actors[:, used], estimates[:, used])[1]
    if rule.exclusive:
        rows, columns = linear_sum_assignment(np.minimum(means, FAR))
        return [(int(row), estimates[column]) for row, column in zip(rows, columns)]
    return [(row, estimates[int(means[row].argmin())]) for row in range(len(actors))]


def _report(rule: PcpRule, counts: dict[int, list[Array]]) -> PcpReport:
    numbers = sorted(counts)
    shares = np.full((len(PARTS), len(numbers)), np.nan)
    for column, number in enumerate(numbers):
        if counts[number]:
            shares[:, column] = np.mean(counts[number], axis=0)
    by_actor = shares.mean(axis=0)
    averaged = np.array([n < AVERAGED_ACTORS and bool(counts[n]) for n in numbers], bool)
    limb_means = shares[:, averaged].mean(axis=1) if averaged.any() else np.full(len(PARTS), np.nan)
    return PcpReport(
        rule=rule.name,
        limbs=tuple(name for name, _, _ in PARTS),
        actors=tuple(n + 1 for n in numbers),
        poses=tuple(len(counts[n]) for n in numbers),
        by_limb=tuple(map(tuple, shares.tolist())),
        limb_means=tuple(limb_means.tolist()),
        by_actor=tuple(by_actor.tolist()),
        mean=float(by_actor[averaged].mean()) if averaged.any() else float("nan"),
    )
