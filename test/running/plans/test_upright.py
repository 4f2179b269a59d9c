"""What a run says and does where cameras are rolled, or no file states which way is up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from panoptic_ros.detection.config import DetectionConfig
from panoptic_ros.detection.upright import NOT_KNOWN
from panoptic_ros.domain import Camera, Rig, SkeletonModel
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.graph.build import configure
from panoptic_ros.params import config_of
from panoptic_ros.running.plans.options import RunOptions
from panoptic_ros.running.plans.plan import Plan

SKELETON = SkeletonModel("two", ("a", "b"), 0, ((0, 1),), 0, bias_floors=(0.01, 0.01))
LENS = Intrinsics(np.array([[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]]), np.zeros(5))
LEVEL = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
ON_ITS_SIDE = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # its top is on the right
RIG = Rig(
    (
        Camera("left", (640, 480), LENS, Rigid(LEVEL, [0.0, 0.0, 3.0])),
        Camera("right", (480, 640), LENS, Rigid(ON_ITS_SIDE, [0.5, 0.0, 3.0])),
    )
)


def completed(rig: Rig, stage: str = "detection", **detection: object) -> tuple[tuple[float, ...], str]:
    """Return the direction among the parameters, and the notices of the run."""
    configs = configure({"detection": detection})
    plan = RunOptions().complete(Plan("a capture", rig, SKELETON, configs, stage=stage))
    return config_of(plan.configs, DetectionConfig).up, " ".join(plan.notices)


def test_images_that_are_turned_are_named() -> None:
    up, told = completed(RIG)
    assert up == () and "right by 90 degrees" in told and "left" not in told


def test_where_nobody_states_up_a_command_is_named_and_detection_is_told() -> None:
    up, told = completed(replace(RIG, up=None))
    assert up == NOT_KNOWN and "panoptic rig check" in told and "images of right" in told
    assert completed(replace(RIG, up=None), up=(0.0, 0.0, 1.0)) == ((0.0, 0.0, 1.0), completed(RIG)[1])


def test_another_direction_reaches_detection() -> None:
    """The messages between nodes do not carry it."""
    up, told = completed(replace(RIG, up=(-1.0, 0.0, 0.0)))
    assert up == (-1.0, 0.0, 0.0) and "left by" in told


def test_upright_rigs_say_nothing_unless_up_is_assumed() -> None:
    upright = RIG.subset(["left"])
    assert completed(upright) == ((), "")
    assert "+z is assumed" in completed(replace(upright, up=None))[1]


def test_without_images_nothing_is_said() -> None:
    assert completed(RIG, "sync") == ((), "")
