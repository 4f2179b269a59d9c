"""Load the inputs of the detection stage other than the rig: detector, working skeleton and joint map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from panoptic_ros.domain import JointMap, SkeletonModel
from panoptic_ros.io.biases import read_bias_table
from panoptic_ros.io.skeletons import map_joints


def detector_extras(model: str, skeleton: str) -> tuple[SkeletonModel, Mapping[str, Any]]:
    """Return the working skeleton of a model, and the extras of the detection stage's context.

    Args:
        model: name of a model card, or path of a card or an ONNX file.
        skeleton: name or path of the skeleton model.
    """
    # imported here because runs without images do not need onnxruntime
    from panoptic_ros.io.models import load_detector

    detector = load_detector(model)
    working, joint_map = map_joints(skeleton, detector.card.joints)
    working = replace(working, bias_floors=_floors(detector.card.joint_bias, joint_map))
    return working, {"detector": detector, "joint_map": joint_map}


def noise_only(bias_floors: Sequence[float]) -> list[str]:
    """Return a notice if the constant biases of the detector are unknown, so that covariances omit them.

    Args:
        bias_floors: bias standard deviations of the skeleton's joints, see `SkeletonModel`.
    """
    text = (
        "covariances contain only the noise of 2D people, as the constant biases of their detector are "
        "unknown: state them in joint_bias of a model card for `panoptic run`"
    )
    return [] if any(bias_floors) else [text]


def bias_extras(bias_table: str, skeleton: SkeletonModel) -> Mapping[str, Any]:
    """Return the extras that assembly needs for its parameter `bias_table`; empty without a table."""
    return {"bias_table": read_bias_table(bias_table, skeleton)} if bias_table else {}


def _floors(biases: Sequence[float], joint_map: JointMap) -> tuple[float, ...]:
    """Map the bias floors from the detector's joints to the skeleton's joints.

    A joint that is a mean of several detector joints gets their largest bias.
    """
    if not biases:
        return ()
    return tuple(max((biases[s] for s in sources), default=0.0) for sources in joint_map.sources)
