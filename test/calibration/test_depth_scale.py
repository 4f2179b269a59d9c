"""Scale of depth: exact without noise, at the Cramer-Rao bound with it, without outliers."""

import numpy as np
import pytest

from panoptic_ros.calibration.boards import Board
from panoptic_ros.calibration.depth_scale import SeenDepths, depth_scale
from panoptic_ros.calibration.rig_start import CameraInput
from panoptic_ros.calibration.solve import calibrate_rig
from panoptic_ros.calibration.target_views import TargetView
from panoptic_ros.simulation.board_sessions import BoardScene, simulate_board

BOARD = Board("checkerboard", 7, 10, 0.06)
NOISE_1M = 0.002  # m, at 1 m


@pytest.fixture(scope="module")
def calibrated():
    session = simulate_board(BoardScene(2, 60, noise_px=0.1, all_round=True), BOARD.points, 0)
    inputs = [CameraInput(c.name, c.image_size) for c in session.rig.cameras]
    views = [TargetView(*view) for view in session.views]
    return calibrate_rig(inputs, views, BOARD.points, False)


def exact_depths(rig, camera):
    """Depths of the found plane at the pixels of all views of a camera."""
    found = []
    for view in rig.views:
        if view.camera == camera:
            b = view.instant
            placed = BOARD.points[view.numbers] @ rig.state.targets.rotations[b].T
            placed = placed + rig.state.targets.translations[b]
            seen = placed @ rig.state.cameras.rotations[camera].T + rig.state.cameras.translations[camera]
            found.append((view, seen[:, 2]))
    return found


def test_exact_depth_gives_the_exact_scale(calibrated):
    seen = [
        SeenDepths(0, view.stamp_s, view.pixels, depth / 1.02) for view, depth in exact_depths(calibrated, 0)
    ]
    found = depth_scale(calibrated, 0, seen)
    assert found.scale == pytest.approx(1.02, abs=2e-4)
    assert depth_scale(calibrated, 1, seen) is None and depth_scale(calibrated, 0, seen[:3]) is None


def test_the_deviation_is_that_of_the_bound_with_outliers_and_holes(calibrated):
    errors, bounds, stated = [], [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        seen, information = [], 0.0
        for view, depth in exact_depths(calibrated, 0):
            measured = depth + NOISE_1M * depth**2 * rng.standard_normal(len(depth))
            measured[rng.random(len(depth)) < 0.02] += 0.5  # the wall behind the board
            measured[rng.random(len(depth)) < 0.05] = 0.0
            information += (1.0 / (NOISE_1M * depth) ** 2).sum()
            seen.append(SeenDepths(0, view.stamp_s, view.pixels, measured))
        found = depth_scale(calibrated, 0, seen)
        errors.append(found.scale - 1.0)
        stated.append(found.sd)
        bounds.append(information**-0.5)
    bound = float(np.mean(bounds))
    assert np.std(errors) < 1.2 * bound
    assert np.mean(stated) == pytest.approx(bound, rel=0.25)
