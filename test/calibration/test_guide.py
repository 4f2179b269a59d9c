"""The guide of a live calibration says what to show next, by what cameras have seen of the board."""

import numpy as np
import pytest
from board_images import board_poses, small_rig

from panoptic_ros.calibration.boards import parse_board
from panoptic_ros.calibration.guide import FEWEST_LINKS, MOVED, CalibrationGuide
from panoptic_ros.calibration.instants import instants_of
from panoptic_ros.calibration.quality import GOOD_VIEWS, covered_cells, doubts, quality_of
from panoptic_ros.calibration.rig_start import CameraInput
from panoptic_ros.calibration.solve import calibrate_rig
from panoptic_ros.calibration.target_views import TargetView
from panoptic_ros.geometry import Rigid
from panoptic_ros.geometry.rotations import rotations_of

BOARD = parse_board("charuco:5x7:40mm")
RIG = small_rig()
SIZE = RIG.cameras[0].image_size
MIDDLE = BOARD.points.mean(axis=0)


def guide_of(known=False):
    """Return a guide of the cameras, with their lenses if they are known."""
    inputs = []
    for camera in RIG.cameras:
        lens = np.zeros(12)
        lens[:4] = camera.intrinsics.matrix[[0, 1, 0, 1], [0, 1, 2, 2]]
        inputs.append(CameraInput(camera.name, SIZE, known=(lens, np.eye(12)) if known else None))
    return CalibrationGuide(inputs, BOARD.points)


def view_of(camera, pose, time_s=0.0, noise=None):
    """Return the view of a camera; None if fewer than four corners are in its image."""
    model = RIG.cameras[camera]
    world = pose.apply(BOARD.points - MIDDLE)
    pixels, front = model.intrinsics.project(model.cam_from_world.apply(world))
    pixels = pixels + (0.0 if noise is None else noise.normal(0.0, 0.1, pixels.shape))
    inside = front & ((pixels > 0.0) & (pixels < np.array(SIZE) - 1.0)).all(axis=1)
    if inside.sum() < 4:
        return None
    return TargetView(camera, 0, time_s, np.flatnonzero(inside), pixels[inside])


def views_of(pose, time_s=0.0, cameras=(0, 1, 2), noise=None):
    found = (view_of(camera, pose, time_s, noise) for camera in cameras)
    return [view for view in found if view is not None]


def before(camera, x=0.0, y=0.0, away=1.5, tilt_deg=0.0):
    """Return the pose of a board before a camera, tilted about the vertical of its image."""
    turn = rotations_of(np.array([[0.0, np.radians(tilt_deg), 0.0]]))[0]
    in_camera = Rigid(turn, np.array([x, y, away]))
    return RIG.cameras[camera].cam_from_world.inverse().compose(in_camera)


def advice(guide, camera=0):
    return guide.state().cameras[camera].advice


def test_without_a_board_every_camera_asks_for_it():
    state = guide_of().state()
    assert [camera.advice for camera in state.cameras] == [f"show the board to cam{c}" for c in range(3)]
    assert not state.enough and not state.usable and state.error_m is None
    assert state.unsolved == "no board was seen yet"


def test_a_board_at_rest_adds_nothing():
    guide = guide_of()
    assert guide.add(views_of(before(0), 0.0, (0,)))
    assert not guide.add(views_of(before(0), 0.2, (0,)))
    extent = np.linalg.norm(np.ptp(BOARD.points, axis=0))  # m, of a board that faces the camera
    assert not guide.add(views_of(before(0, x=0.8 * MOVED * extent), 0.4, (0,)))
    assert guide.add(views_of(before(0, x=1.2 * MOVED * extent), 0.4, (0,)))
    assert guide.state().cameras[0].views == 2


def test_a_board_that_moves_in_one_camera_adds_the_views_of_all():
    guide = guide_of()
    guide.add(views_of(before(0), 0.0, (0,)))
    assert guide.state().unsolved == "the first views are being solved"
    assert guide.add(views_of(before(0), 0.2, (0, 1)))
    assert [camera.views for camera in guide.state().cameras] == [2, 1, 0]


def test_cells_with_corners_are_covered_and_the_emptiest_side_is_named():
    guide = guide_of(known=True)
    for k, y in enumerate((-0.45, 0.0, 0.45)):
        for x in (0.1, 0.35, 0.6):
            guide.add(views_of(before(0, x, y), 0.2 * k, (0,)))
    expected = np.zeros((3, 4), bool)
    for view in guide.views:
        expected |= covered_cells(view.pixels, SIZE)
    np.testing.assert_array_equal(guide.state().cameras[0].covered, expected)
    assert not expected[:, 0].any() and "cover the left edge" in advice(guide)


@pytest.mark.parametrize("known", [False, True])
def test_tilts_are_asked_for_unless_the_lens_is_known(known):
    guide = guide_of(known)
    for k in range(12):
        guide.add(views_of(before(0, 0.5 * np.sin(k), 0.4 * np.cos(k)), 0.2 * k, (0,)))
    assert guide.state().cameras[0].tilted == 0
    assert advice(guide).startswith("tilt the board by 30 to 60 degrees") != known


def test_tilts_and_distances_are_those_of_the_board():
    guide = guide_of(known=True)
    for k, (away, tilt) in enumerate([(1.0, 0.0), (1.5, 25.0), (2.0, 35.0), (2.5, -50.0)]):
        guide.add(views_of(before(0, away=away, tilt_deg=tilt), 0.2 * k, (0,)))
    state = guide.state().cameras[0]
    assert state.tilted == 2
    assert state.distances == pytest.approx((1.0, 2.5), rel=0.15)  # to the origin of the board


def test_cameras_that_never_share_the_board_are_brought_together():
    guide = guide_of()
    for k in range(6):
        guide.add(views_of(before(0, 0.1 * k), 0.2 * k, (0, 1)))
        guide.add(views_of(before(2, 0.1 * k), 0.2 * k + 5.0, (2,)))
    state = guide.state()
    assert state.links == {(0, 1): 6, (0, 2): 0, (1, 2): 0}
    assert [camera.linked for camera in state.cameras] == [True, True, False]
    assert advice(guide, 2).startswith("show the board to cam1 and cam2 at once")
    assert "at once" not in advice(guide, 0)


def test_views_of_different_times_link_nothing():
    guide = guide_of()
    for k in range(2 * FEWEST_LINKS):
        pair = views_of(before(0, 0.1 * k), 0.2 * k, (0,)) + views_of(before(0, 0.1 * k), 0.2 * k + 3.0, (1,))
        guide.add(pair)
    assert guide.state().links[0, 1] == 0


def test_a_good_recording_is_enough_and_the_limits_are_those_of_the_report():
    guide, noise = guide_of(), np.random.default_rng(1)
    guesses = []
    for k, pose in enumerate(board_poses(60, seed=4)):
        guide.add(views_of(pose, 0.2 * k, noise=noise))
        if k in (19, 59):
            views = guide.views
            numbers = instants_of(
                np.array([view.camera for view in views]), np.array([view.stamp_s for view in views])
            )
            placed = [
                TargetView(view.camera, int(n), view.stamp_s, view.numbers, view.pixels)
                for view, n in zip(views, numbers)
            ]
            inputs = [CameraInput(camera.name, SIZE) for camera in RIG.cameras]
            rig = calibrate_rig(inputs, placed, BOARD.points, clocks=False)
            quality = quality_of(rig)
            guide.solved(quality, rig.state.cameras.lenses)
            guesses.append((guide.state(), doubts(quality)))
    for state, found in guesses:
        assert state.enough == (not found), found
        assert bool(state.advice or any(camera.advice for camera in state.cameras)) == bool(found)
        assert state.usable
    assert guesses[-1][0].enough


def test_views_that_give_no_calibration_tell_the_reason():
    guide = guide_of()
    guide.add(views_of(before(0), 0.0, (0,)))
    guide.not_solved("camera cam1 sees the board in 0 images")
    state = guide.state()
    assert state.error_m is None and state.unsolved == "camera cam1 sees the board in 0 images"
    assert f"show {GOOD_VIEWS - 1} more views" not in advice(guide)  # two more useful steps come first
