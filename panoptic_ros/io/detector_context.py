"""What the detection stage needs besides the rig: the model, and the way to the working skeleton."""
from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from panoptic_ros.domain import SkeletonModel
from panoptic_ros.io.models import load_detector
from panoptic_ros.io.skeletons import map_joints


def detector_extras(model: str, skeleton: str) -> tuple[SkeletonModel, Mapping[str, Any]]:
    """The working skeleton for a model, and the extras of the stage's context.

    Args:
        model: name of a card, or path of a card or an ONNX file.
        skeleton: name or path of the skeleton model.
    """
    detector = load_detector(model)
    working, joint_map = map_joints(skeleton, detector.card.joints)
    return working, {"detector": detector, "joint_map": joint_map}
