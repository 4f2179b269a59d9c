"""Calibration of simulated rigs: exact without noise, as certain as stated with it, from blind starts."""

import numpy as np
import pytest

from panoptic_ros.calibration.boards import Board
from panoptic_ros.calibration.lens_start import LensModel
from panoptic_ros.calibration.projection import OFFSET
from panoptic_ros.calibration.rig_start import CameraInput
from panoptic_ros.calibration.solve import calibrate_rig
from panoptic_ros.calibration.target_views import TargetView, image_speeds
from panoptic_ros.errors import CalibrationError
from panoptic_ros.simulation.board_sessions import BoardScene, simulate_board
from panoptic_ros.study.calibration.boards import errors_of

BOARD = Board("checkerboard", 7, 10, 0.06)
FISHEYE = LensModel(fisheye=True, terms=4)


def recorded(scene, seed=0):
    session = simulate_board(scene, BOARD.points, seed)
    return session, [TargetView(*view) for view in session.views]


def inputs_of(session, model=None):
    return [CameraInput(c.name, c.image_size, model or LensModel()) for c in session.rig.cameras]


@pytest.mark.parametrize("lens", ["brown", "fisheye"])
def test_exact_corners_give_the_exact_rig(lens):
    session, views = recorded(BoardScene(4, 60, noise_px=0.0, lens=lens))
    found = calibrate_rig(
        inputs_of(session, FISHEYE if lens == "fisheye" else None), views, BOARD.points, False
    )
    errors = errors_of(found, session)
    assert errors["error_m"] < 2e-5  # only the weak priors of the lenses cause errors
    assert errors["focal"] < 1e-5


def test_errors_are_as_large_as_stated():
    ratios, nees = [], []
    for seed in range(8):
        session, views = recorded(BoardScene(4, 60), seed)
        errors = errors_of(calibrate_rig(inputs_of(session), views, BOARD.points, False), session)
        ratios.append(errors["ratio"])
        nees.append(errors["nees"])
    assert 0.6 < np.median(ratios) < 1.5
    assert 0.5 < np.mean(nees) < 1.7


def test_outliers_are_left_out():
    session, views = recorded(BoardScene(4, 60, outliers=0.02))
    found = calibrate_rig(inputs_of(session), views, BOARD.points, False)
    corners = sum(len(view.numbers) for view in views)
    assert 0.012 * corners < found.outliers.sum() < 0.025 * corners
    assert errors_of(found, session)["ratio"] < 2.5
    assert found.noise == pytest.approx(0.3, rel=0.1)


def test_a_wrong_grid_in_one_image_is_left_out():
    session, views = recorded(BoardScene(4, 40))
    wrong = next(k for k, view in enumerate(views) if len(view.numbers) == len(BOARD.points))
    view = views[wrong]
    shifted = TargetView(
        view.camera, view.instant, view.stamp_s, view.numbers, np.roll(view.pixels, 7, axis=0)
    )
    changed = [*views[:wrong], shifted, *views[wrong + 1 :]]
    found = calibrate_rig(inputs_of(session), changed, BOARD.points, False)
    assert found.outliers[view.camera] > 0.9 * len(view.numbers)
    assert errors_of(found, session)["ratio"] < 2.5


def test_clocks_of_cameras_are_found():
    session, views = recorded(BoardScene(4, 120, smooth=True, lag_s=0.06))
    found = calibrate_rig(inputs_of(session), views, BOARD.points)
    late = found.state.cameras.offsets - (session.offsets - session.offsets[0])
    assert np.abs(late[1:]).max() < 0.004
    assert found.index[0, OFFSET] == -1
    assert np.abs(found.state.cameras.jitter).max() < 0.01


def test_random_delays_of_images_are_found():
    session, views = recorded(BoardScene(4, 150, smooth=True, jitter_s=0.015))
    found = calibrate_rig(inputs_of(session), views, BOARD.points)
    assert found.state.cameras.jitter == pytest.approx(0.015, rel=0.6)
    still = calibrate_rig(inputs_of(session), views, BOARD.points, clocks=False)
    assert errors_of(found, session)["error_m"] < 0.5 * errors_of(still, session)["error_m"]


def test_a_camera_without_common_views_is_named():
    session, views = recorded(BoardScene(3, 40))
    apart = [
        TargetView(
            view.camera, view.instant + 1000 * (view.camera == 2), view.stamp_s, view.numbers, view.pixels
        )
        for view in views
    ]
    with pytest.raises(CalibrationError, match="camera cam2 never sees the board together with cam0"):
        calibrate_rig(inputs_of(session), apart, BOARD.points, False)


def test_a_camera_with_too_few_views_is_named():
    session, views = recorded(BoardScene(3, 40))
    few = [view for view in views if view.camera != 1 or view.instant < 5][:]
    kept = [view for view in few if view.camera != 1] + [view for view in few if view.camera == 1][:2]
    with pytest.raises(CalibrationError, match="camera cam1 sees the board in 2 images, at least 3"):
        calibrate_rig(inputs_of(session), kept, BOARD.points, False)


def test_image_speeds_are_slopes_of_parabolas():
    times = np.array([0.0, 0.1, 0.3, 2.0])
    points = np.array([[0.0, 0.0], [5.0, 1.0]])
    views = [
        TargetView(0, k, t, np.arange(2), points + np.array([3.0 * t + 10.0 * t * t, -2.0 * t]))
        for k, t in enumerate(times)
    ]
    speeds = image_speeds(views, times)
    np.testing.assert_allclose(speeds[1], [[5.0, -2.0]] * 2, atol=1e-9)
    np.testing.assert_allclose(speeds[0], [[4.0, -2.0]] * 2, atol=1e-9)  # difference to one neighbour
    np.testing.assert_allclose(speeds[3], 0.0)  # no neighbour within half a second
