"""Rigs that are given: centred, scaled, paired by place."""

from dataclasses import replace

import numpy as np

from panoptic_ros.domain import Rig
from panoptic_ros.geometry import Rigid
from panoptic_ros.simulation import NOISY, PanelDome, Ring, simulate
from panoptic_ros.simulation.studio import centred, nearest_pairs, relative_noise, scaled, study_scene

RIG = Ring(5).build(np.random.default_rng(2))


def moved(rig, shift):
    back = Rigid(np.eye(3), -np.array(shift))
    return Rig(tuple(replace(c, cam_from_world=c.cam_from_world.compose(back)) for c in rig.cameras))


def test_a_rig_elsewhere_is_brought_back_to_the_origin():
    centre = np.array([c.centre for c in centred(moved(RIG, [7.0, -3.0, 0.0])).cameras])
    expected = np.array([c.centre for c in centred(RIG).cameras])
    assert np.allclose(centre, expected, atol=0.01)  # the weak tie to where all look moves it a little
    assert np.linalg.norm(centre[:, :2].mean(axis=0)) < 0.6
    assert np.allclose(centre[:, 2], [c.centre[2] for c in RIG.cameras])


def test_a_scaled_camera_sees_the_same_rays():
    camera = RIG.cameras[2]
    half = scaled(camera, 0.5)
    points = np.random.default_rng(0).normal(0.0, 0.5, (20, 3)) + [0, 0, 1]
    full, seen = camera.project(points)
    assert half.image_size == (960, 540) and seen.all()
    assert np.allclose(half.project(points)[0] + 0.5, 0.5 * (full + 0.5))


def test_pairs_are_the_nearest_and_used_once():
    other = PanelDome(3).build(np.random.default_rng(1))
    ours, theirs = nearest_pairs(PanelDome(1).build(np.random.default_rng(3)), other, 7)
    assert len(ours) == len(theirs) == 7


def test_noise_is_a_share_of_the_size_and_people_are_in_the_rig():
    faults = relative_noise(0.01)
    assert faults.noise_px == 2.5 and faults.size_px == 250.0 and faults.ghosts == NOISY.ghosts
    take = simulate(study_scene(RIG, 3, 1.5, faults), 0, 2)
    assert len(take.people) == 3 and take.rig.names == RIG.names
    assert np.array_equal(next(iter(take.detection_sets())).views[0].points.shape[1:], (19, 2))
