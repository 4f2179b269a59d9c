"""What the detection stage needs besides the rig: the model, and the way to the working skeleton."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from panoptic_ros.domain import JointMap, SkeletonModel
from panoptic_ros.io.biases import read_bias_table
from panoptic_ros.io.skeletons import map_joints


def detector_extras(model: str, skeleton: str) -> tuple[SkeletonModel, Mapping[str, Any]]:
    """The working skeleton for a model, and the extras of the stage's context.

    Args:
        model: name of a card, or path of a card or an ONNX file.
        skeleton: name or path of the skeleton model.
    """
    from panoptic_ros.io.models import load_detector  # only now: without images nobody needs onnxruntime

    detector = load_detector(model)
    working, joint_map = map_joints(skeleton, detector.card.joints)
    working = replace(working, bias_floors=_floors(detector.card.joint_bias, joint_map))
    return working, {"detector": detector, "joint_map": joint_map}


def noise_only(bias_floors: Sequence[float]) -> list[str]:
    """Return a line if the detector's constant biases are not known, so that covariances lack them.

    Args:
        bias_floors: of the skeleton, see `SkeletonModel`.
    """
    text = (
        "covariances hold the noise of 2D people alone, as the constant biases of their detector are not "
        "known: joint_bias of a model card tells them to `panoptic run`"
    )
    return [] if any(bias_floors) else [text]


def bias_extras(bias_table: str, skeleton: SkeletonModel) -> Mapping[str, Any]:
    """What assembly needs for its parameter `bias_table`: nothing if that is empty."""
    return {"bias_table": read_bias_table(bias_table, skeleton)} if bias_table else {}


def _floors(biases: Sequence[float], joint_map: JointMap) -> tuple[float, ...]:
    """Biases of the detector's joints as those of the skeleton's; the sources of a mean share theirs."""
    if not biases:
        return ()
    return tuple(max((biases[s] for s in sources), default=0.0) for sources in joint_map.sources)
