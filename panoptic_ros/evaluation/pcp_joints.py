"""The 14 joints of the Shelf and Campus annotation, made from those of a detector.

The annotation marks the bottom and the top of the head, which no common detector reports; how they are
made from nose, ears and shoulders is part of a protocol and moves its numbers by points.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from panoptic_ros.errors import DataError

Array = np.ndarray

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


def plain_name(name: str) -> str:
    """A joint's name in snake case with the side first: lShoulder and LShoulder are left_shoulder."""
    sided = re.fullmatch(r"([lLrR])([A-Z][A-Za-z]*)", name)
    if sided:
        return ("left_" if sided[1] in "lL" else "right_") + sided[2].lower()
    return {"BodyCenter": "mid_hip", "MidHip": "mid_hip"}.get(name, name.lower())


class NamedJoints:
    """Joints (P, J, 3) m by their plain names; NaN where one is missing."""

    def __init__(self, joint_names: Sequence[str], positions: Array):
        self._columns = {plain_name(name): i for i, name in enumerate(joint_names)}
        self._positions = positions

    def __contains__(self, name: str) -> bool:
        return name in self._columns

    def __getitem__(self, name: str) -> Array:
        """Positions (P, 3).

        Raises:
            DataError: if the skeletons have no such joint.
        """
        if name not in self._columns:
            raise DataError(f"PCP needs the joint {name}, which the result does not have")
        return self._positions[:, self._columns[name]]

    def middle(self, name: str) -> Array:
        """Mean (P, 3) of the left and right joint; the other one where one of them is missing."""
        left, right = self["left_" + name], self["right_" + name]
        both = 0.5 * (left + right)
        return np.where(np.isnan(left), right, np.where(np.isnan(right), left, both))


def annotated_joints(joints: NamedJoints, head: Array) -> Array:
    """The 14 annotation joints (P, 14, 3) m; `head` (P, 2, 3) is its bottom and top."""
    body = np.stack([joints[name] for name in BODY_JOINTS], axis=1)
    return np.concatenate([body, head], axis=1)


def head_of_voxelpose(joints: NamedJoints) -> Array:
    """Bottom and top of the head (P, 2, 3) m as VoxelPose's evaluation has them."""
    shoulders, ears, nose = joints.middle("shoulder"), joints.middle("ear"), joints["nose"]
    centre = 0.5 * (shoulders + ears)
    bottom = shoulders + 0.5 * (nose - shoulders)
    top = shoulders + np.array([0.75, 0.75, 1.5]) * (nose - shoulders)
    skull = centre + 2.0 * (ears - centre)
    return np.stack([0.75 * bottom + 0.25 * centre, 0.75 * top + 0.25 * skull], axis=1)


def head_of_association(joints: NamedJoints) -> Array:
    """Bottom and top of the head (P, 2, 3) m as 4D Association's evaluation has them."""
    shoulders, ears = joints.middle("shoulder"), joints.middle("ear")
    neck = joints["neck"] if "neck" in joints else shoulders
    hips = joints["mid_hip"] if "mid_hip" in joints else joints.middle("hip")
    across = joints["right_shoulder"] - joints["left_shoulder"]
    forward = np.cross(neck - hips, across)
    forward /= np.linalg.norm(forward, axis=-1, keepdims=True)
    bottom = shoulders + 0.5 * (ears - shoulders)
    return np.stack([bottom, bottom + 0.125 * forward + 0.145 * UP], axis=1)
