"""The factor of variances for errors that the points of a target share, against the true errors."""

from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.calibration.boards import Board
from panoptic_ros.calibration.rig_start import CameraInput
from panoptic_ros.calibration.shared_errors import shared_errors
from panoptic_ros.calibration.solve import calibrate_rig
from panoptic_ros.calibration.target_views import TargetView
from panoptic_ros.simulation.board_sessions import BoardScene, simulate_board
from panoptic_ros.study.calibration.boards import errors_of

BOARD = Board("checkerboard", 7, 10, 0.06)


def calibrated(scene, seed, clocks, shift_px=0.0):
    """Calibrate a scene; `shift_px` is the deviation of a shift that all points of a view share."""
    session = simulate_board(scene, BOARD.points, seed)
    rng = np.random.default_rng(seed)
    views = [TargetView(*view) for view in session.views]
    views = [replace(view, pixels=view.pixels + shift_px * rng.standard_normal(2)) for view in views]
    inputs = [CameraInput(camera.name, camera.image_size) for camera in session.rig.cameras]
    return calibrate_rig(inputs, views, BOARD.points, clocks), session


def factor_of(found):
    return shared_errors(found.seen, found.state, found.covariance, found.index)


def test_independent_noise_has_the_factor_one():
    assert np.mean([factor_of(calibrated(BoardScene(4, 60), seed, False)[0]) for seed in range(4)]) < 1.15


def test_the_factor_is_the_growth_of_the_squared_errors():
    squares, stated = [], []
    for seed in range(6):
        found, session = calibrated(BoardScene(4, 60), seed, False, shift_px=0.3)
        errors = errors_of(found, session)
        squares.append(errors["nees"])
        stated.append(factor_of(found))
    assert 4.0 < np.mean(stated) < 30.0  # 70 points share a shift as large as their own noise
    assert np.mean(squares) / np.mean(stated) == pytest.approx(1.0, rel=0.6)


def test_errors_of_cameras_with_random_delays_are_not_larger_than_stated():
    scene = BoardScene(4, 120, smooth=True, lag_s=0.06, jitter_s=0.015)
    ratios = [errors_of(*calibrated(scene, seed, True))["ratio"] for seed in range(4)]
    assert 0.4 < np.median(ratios) < 1.5  # 1.9 without the factor


def test_few_views_are_enough(monkeypatch):
    found, _ = calibrated(BoardScene(4, 120), 0, False, shift_px=0.3)
    whole = factor_of(found)
    monkeypatch.setattr("panoptic_ros.calibration.shared_errors.MOST_VIEWS", 100)
    assert factor_of(found) == pytest.approx(whole, rel=0.5)
