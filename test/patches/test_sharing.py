"""How many points each view follows, where many views see a person."""

from dataclasses import replace

import captures
import numpy as np
import pytest

from panoptic_ros.domain import Rig
from panoptic_ros.patches.flow.stage import PointAllocation, PointPattern
from panoptic_ros.simulation.rigs import Ring

THERE = np.ones((1, len(captures.SKELETON)), bool)


def ring(cameras):
    return Ring(cameras).build(np.random.default_rng(3))


def followed(rig, views, first=None):
    """Which points of somebody in the middle each camera follows, the first of them alone."""
    sharing, found = PointAllocation(rig, views), []
    for camera in rig.cameras[:first]:
        pixels, _ = camera.project(captures.person((0.1, -0.2), 0.4))
        laid = PointPattern(captures.SKELETON).lay(pixels[None], THERE)
        shares = sharing.shares(camera.name, laid.middles, laid.scales)
        found.append(sharing.followed(camera.name, laid.persons, shares))
    return np.array(found)


@pytest.mark.parametrize(("cameras", "views"), [(6, 6), (4, 6), (20, 0)])
def test_few_views_follow_all_points(cameras, views):
    assert followed(ring(cameras), views).all()


@pytest.mark.parametrize("cameras", [8, 16, 60])
def test_more_views_follow_as_many_points_in_all_as_six(cameras):
    found = followed(ring(cameras), 6)
    assert found.sum() == pytest.approx(6 * found.shape[1], rel=0.05)
    each = found.sum(axis=0)  # of each point of the pattern, how many views follow it
    assert each.min() >= 4 and each.max() <= 8


def test_views_that_look_elsewhere_take_no_share():
    """Two rings of six, 100 m apart: each sees its own people alone."""
    here = ring(6)
    there = tuple(
        replace(
            camera,
            name=f"far{camera.name}",
            cam_from_world=replace(
                camera.cam_from_world,
                translation=camera.cam_from_world.translation
                - camera.cam_from_world.rotation @ np.array([100.0, 0.0, 0.0]),
            ),
        )
        for camera in ring(6).cameras
    )
    assert followed(Rig((*here.cameras, *there)), 6, first=6).all()


def test_each_person_has_a_share_of_the_own():
    """Whom all of a rig see shares; nobody shares him of whom nothing is known."""
    rig = ring(12)
    camera, scale = rig.cameras[0], rig.stack().focals[0] / Ring(12).radius
    middles = np.array([np.array(camera.image_size) / 2.0, [np.nan, np.nan]])
    shares = PointAllocation(rig, 6).shares("cam00", middles, np.array([scale, np.nan]))
    assert shares.tolist() == [0.5, 1.0]
    assert PointAllocation(rig, 6).shares("cam00", np.zeros((0, 2)), np.zeros(0)).shape == (0,)
