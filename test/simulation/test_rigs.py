"""Rigs look at the space, in every size."""

from __future__ import annotations

import numpy as np
import pytest

from panoptic_ros.errors import UsageError
from panoptic_ros.simulation import Corners, Dome, Lens, PanelDome, Ring
from panoptic_ros.simulation.rigs import VGA, looking_at

PLANS = [Ring(5), Ring(10, radius=4.6), Corners(3), Corners(5), Dome(31), PanelDome(24)]


@pytest.mark.parametrize("plan", PLANS, ids=lambda plan: type(plan).__name__)
def test_every_camera_sees_the_middle_of_the_space(plan):
    rig = plan.build(np.random.default_rng(0))
    assert len(rig) == getattr(plan, "cameras", None) or len(rig) == 480
    assert len(set(rig.names)) == len(rig)
    for camera in rig.cameras:
        assert camera.sees(np.array([0.0, 0.0, 1.0]))
        assert camera.centre[2] > 0.3


def test_distorted_lenses_are_dealt_out():
    def count(every):
        lens = Lens(VGA, (430.0, 440.0), distorted_every=every)
        rig = Ring(6, lens=lens).build(np.random.default_rng(0))
        return [bool(camera.intrinsics.distortion.any()) for camera in rig.cameras]

    assert count(0) == [False] * 6 and count(1) == [True] * 6
    assert count(3) == [False, False, True] * 2


def test_looking_at_puts_the_target_on_the_axis_and_up_is_up():
    pose = looking_at(np.array([3.0, 1.0, 2.0]), np.array([0.0, 0.0, 1.0]))
    assert pose.apply(np.array([0.0, 0.0, 1.0]))[:2] == pytest.approx([0.0, 0.0])
    assert pose.apply(np.array([0.0, 0.0, 1.5]))[1] < 0.0, "y points down in the camera"


def test_impossible_rigs_are_named():
    for plan in (Ring(0), Corners(6), Dome(0), PanelDome(0)):
        with pytest.raises(UsageError):
            plan.build(np.random.default_rng(0))
