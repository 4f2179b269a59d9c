"""Bystanders stand beyond the space that a rig covers."""

import captures
import numpy as np

from panoptic_ros.domain import Camera
from panoptic_ros.geometry import Rigid
from panoptic_ros.solving.capture_space import in_capture_space, most_overlap, needed_views

CAMERAS = captures.RIG.cameras


def test_few_cameras_on_one_place_need_two_fields_of_view():
    assert [needed_views(3, CAMERAS[:n]) for n in (2, 3, 4)] == [2, 2, 3]
    assert needed_views(2, CAMERAS) == 2


def test_cameras_that_look_elsewhere_or_stand_at_one_place_do_not_count():
    up = Rigid(np.eye(3), np.array([0.0, 0.0, -9.0]))
    blind = [Camera(f"up{k}", CAMERAS[0].image_size, CAMERAS[0].intrinsics, up) for k in range(6)]
    assert needed_views(3, [*CAMERAS[:3], *blind]) == 2
    assert most_overlap([*CAMERAS[:2], *blind], 100) == 2
    assert most_overlap(blind, 100) == 1


def test_person_in_the_middle_stays_though_two_views_show_it():
    middle = captures.person((0.0, 0.0), 0.0)[None]
    assert in_capture_space(middle, np.array([2]), CAMERAS, 3).tolist() == [True]


def test_person_behind_a_camera_is_a_bystander_unless_enough_views_show_it():
    eye = CAMERAS[0].centre
    behind = captures.person((1.3 * eye[0], 1.3 * eye[1]), 0.0)[None]
    assert in_capture_space(behind, np.array([2]), CAMERAS, 3).tolist() == [False]
    assert in_capture_space(behind, np.array([3]), CAMERAS, 3).tolist() == [True]


def test_missing_joints_do_not_count():
    person = captures.person((0.0, 0.0), 0.0)[None].copy()
    person[:, 5:] = np.nan
    assert in_capture_space(person, np.array([2]), CAMERAS, 3).tolist() == [True]
