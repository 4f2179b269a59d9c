"""Joints of simulated people: the 19 joints of the CMU Panoptic data set."""

from __future__ import annotations

import numpy as np

from panoptic_ros.domain import SkeletonModel

JOINTS = (
    "Neck",
    "Nose",
    "BodyCenter",
    "lShoulder",
    "lElbow",
    "lWrist",
    "lHip",
    "lKnee",
    "lAnkle",
    "rShoulder",
    "rElbow",
    "rWrist",
    "rHip",
    "rKnee",
    "rAnkle",
    "lEye",
    "lEar",
    "rEye",
    "rEar",
)
J = {name: index for index, name in enumerate(JOINTS)}
SIDES = (("l", 1.0), ("r", -1.0))  # (first letter of the joints, sign of the body's y axis)

_BONES = (
    "BodyCenter Neck",
    "Neck Nose",
    "Neck lShoulder",
    "lShoulder lElbow",
    "lElbow lWrist",
    "Neck rShoulder",
    "rShoulder rElbow",
    "rElbow rWrist",
    "BodyCenter lHip",
    "lHip lKnee",
    "lKnee lAnkle",
    "BodyCenter rHip",
    "rHip rKnee",
    "rKnee rAnkle",
    "Nose lEye",
    "lEye lEar",
    "Nose rEye",
    "rEye rEar",
)
_PAIRED = ("Shoulder", "Elbow", "Wrist", "Hip", "Knee", "Ankle", "Eye", "Ear")

SKELETON = SkeletonModel(
    name="panoptic19",
    joint_names=JOINTS,
    root=J["BodyCenter"],
    bones=tuple((J[a], J[b]) for a, b in (bone.split() for bone in _BONES)),
    head=J["Nose"],
    left_right=tuple((J["l" + name], J["r" + name]) for name in _PAIRED),
)


def both_sides(*names: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the indices of the left and of the right joints of these names."""
    return np.array([J["l" + name] for name in names]), np.array([J["r" + name] for name in names])
