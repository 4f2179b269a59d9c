"""Stretch of a print: estimated with an honest deviation, from views of any camera."""

import numpy as np
import pytest

from panoptic_ros.calibration.boards import Board
from panoptic_ros.calibration.rig_start import CameraInput
from panoptic_ros.calibration.solve import calibrate_rig
from panoptic_ros.calibration.stretch import jackknife_sd, stretch_of
from panoptic_ros.calibration.target_views import TargetView
from panoptic_ros.simulation.board_sessions import BoardScene, simulate_board

BOARD = Board("checkerboard", 7, 10, 0.06)


def calibrated(stretch, seed):
    printed = BOARD.points * [1.0 + 0.5 * stretch, 1.0 - 0.5 * stretch, 1.0]
    session = simulate_board(BoardScene(4, 60), printed, seed)
    inputs = [CameraInput(c.name, c.image_size) for c in session.rig.cameras]
    return calibrate_rig(inputs, [TargetView(*view) for view in session.views], BOARD.points, False)


@pytest.mark.parametrize("stretch", [0.0, 0.003, -0.01])
def test_the_stretch_is_found_with_its_deviation(stretch):
    errors = []
    for seed in range(4):
        found, sd = stretch_of(calibrated(stretch, seed))
        assert sd < 6e-4
        errors.append((found - stretch) / sd)
    assert np.abs(errors).max() < 3.5


def test_the_jackknife_states_the_same_deviation_for_white_noise():
    rig = calibrated(0.0, 1)
    assert 0.4 < jackknife_sd(rig) / stretch_of(rig)[1] < 2.5
