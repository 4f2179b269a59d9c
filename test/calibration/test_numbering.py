"""Boards that look the same after a turn: any numbering gives the true calibration."""

from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.calibration.boards import Board
from panoptic_ros.calibration.rig_start import CameraInput
from panoptic_ros.calibration.solve import calibrate_rig
from panoptic_ros.calibration.target_views import TargetView
from panoptic_ros.simulation.board_sessions import BoardScene, simulate_board
from panoptic_ros.study.calibration.boards import errors_of

SCENES = {"still": BoardScene(4, 60), "moving": BoardScene(4, 120, smooth=True, lag_s=0.03)}


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
@pytest.mark.parametrize("size", [(8, 6), (7, 7)])
def test_any_numbering_of_views_gives_the_same_rig(scene, size):
    board = Board("checkerboard", *size, 0.06)
    session = simulate_board(scene, board.points, 0)
    inputs = [CameraInput(c.name, c.image_size) for c in session.rig.cameras]
    true = [TargetView(*view) for view in session.views]
    rng = np.random.default_rng(1)
    turned = []
    for view in true:
        numbers = view.numbers
        if size[0] == size[1]:
            for _ in range(rng.integers(4)):  # quarter turns
                numbers = size[0] - 1 - numbers // size[0] + size[0] * (numbers % size[0])
        elif rng.random() < 0.5:
            numbers = len(board.points) - 1 - numbers
        turned.append(replace(view, numbers=numbers))
    exact = errors_of(calibrate_rig(inputs, true, board.points, scene.smooth), session)
    found = errors_of(calibrate_rig(inputs, turned, board.points, scene.smooth, board.turns), session)
    assert found["error_m"] == pytest.approx(exact["error_m"], rel=0.05)
