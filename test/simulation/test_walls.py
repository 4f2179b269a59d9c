"""Walls hide what is behind them, in detections and as occluders alike."""

from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.association.known_occluders import occluded_depths
from panoptic_ros.domain import VisibilityLimit
from panoptic_ros.simulation import CLEAN, SCENES, simulate
from panoptic_ros.simulation.walls import Wall, behind_walls, occluders_of


def test_a_line_of_sight_ends_at_a_wall():
    wall = Wall((4.0, 0.2, 2.0), (1.0, 0.0))  # x from -1 to 3, y about 0, up to 2 m
    eye = np.array([[0.0, -2.0, 1.0]])
    points = np.array([[0.0, 2.0, 1.0], [0.0, -1.0, 1.0], [-3.0, 2.0, 1.0], [0.0, 2.0, 4.0], [0.0, 0.0, 1.0]])
    assert behind_walls(eye, points[None, None], [wall]).tolist() == [[[True, False, False, False, True]]]
    assert not behind_walls(eye, points[None, None], []).any()


def test_the_walls_of_a_scene_hide_from_the_rig_what_they_hide_from_the_detector():
    scene = replace(SCENES["rooms-4p31v"], degradation=CLEAN)
    take = simulate(scene, 3, 1)
    centres = np.array([camera.centre for camera in take.rig.cameras])
    joints = np.stack([person.joints(np.zeros(31)) for person in take.people], axis=1)
    hidden = behind_walls(centres, joints, scene.walls)
    assert 0.6 < hidden.mean() < 0.8  # everybody is seen by the cameras of one side
    for camera, places, expected in zip(take.rig.cameras, joints, hidden):
        limit = VisibilityLimit.of_depths(occluded_depths(camera, take.rig.occluders), 0.0)
        pixels, ahead = camera.project(places)
        inside = ahead & camera.contains(pixels)
        depths = camera.cam_from_world.apply(places)[..., 2]
        seen = limit.sees(np.where(inside[..., None], pixels, 0.0), depths, camera.image_size)
        assert (seen != expected)[inside].mean() > 0.95
    item = next(take.detection_sets())
    most = np.array([len(view.points) for view in item.views])
    assert most.max() <= 3 and most.mean() == pytest.approx(1.3, abs=0.4)


def test_without_walls_a_rig_knows_no_occluders():
    assert occluders_of(()) is None and simulate(SCENES["clean-4p5v"], 0, 1).rig.occluders is None
