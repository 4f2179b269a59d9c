"""Adjustment: its covariance and steps against dense normal equations by finite differences."""

from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.calibration.boards import Board
from panoptic_ros.calibration.bundle import PLAIN, Targets, adjust, covariance_of, residuals_of, total_cost
from panoptic_ros.calibration.normal_equations import moved
from panoptic_ros.calibration.projection import CAMERA, OFFSET, POSE
from panoptic_ros.calibration.rig_start import CameraInput, start_rig
from panoptic_ros.calibration.target_views import TargetView, observations_of
from panoptic_ros.simulation.board_sessions import BoardScene, simulate_board

BOARD = Board("checkerboard", 4, 3, 0.1)
STEP = 1e-6


@pytest.fixture(scope="module")
def problem():
    session = simulate_board(BoardScene(5, 20), BOARD.points, 3)
    views = [TargetView(*view) for view in session.views]
    start = start_rig([CameraInput(c.name, c.image_size) for c in session.rig.cameras], views, BOARD.points)
    seen = observations_of(start.views, BOARD.points, np.full(5, 0.3))
    rng = np.random.default_rng(0)
    seen = seen._replace(twists=rng.normal(size=seen.twists.shape))
    free = start.state.cameras.free.copy()
    free[1:, OFFSET] = True
    cameras = replace(start.state.cameras, free=free, jitter=np.array([0.01, 0.02, 0.0, 0.01, 0.01]))
    return seen, adjust(seen, replace(start.state, cameras=cameras), PLAIN)


def perturbed(state, step, free, late):
    """Return the state after a step of all unknowns: free ones of cameras, poses of targets, shifts."""
    cameras, targets = state.cameras, state.targets
    own = np.zeros((len(cameras), CAMERA))
    count = int(free.sum())
    own[free] = step[:count]
    size = POSE * len(targets.rotations)
    pose = step[count : count + size].reshape(-1, POSE)
    shifts = state.shifts.copy()
    shifts[late] += step[count + size :]
    turns, moves = moved(cameras.rotations, cameras.translations, own[:, :POSE])
    return replace(
        state,
        cameras=replace(
            cameras,
            rotations=turns,
            translations=moves,
            lenses=cameras.lenses + own[:, POSE:OFFSET],
            offsets=cameras.offsets + own[:, OFFSET],
        ),
        targets=Targets(*moved(targets.rotations, targets.translations, pose)),
        shifts=shifts,
    )


def test_covariance_is_that_of_dense_normal_equations(problem):
    seen, state = problem
    cameras = state.cameras
    late = cameras.jitter[seen.cameras]
    size = int(cameras.free.sum()) + POSE * len(state.targets.rotations) + int((late > 0).sum())

    def stacked(step):
        now = perturbed(state, step, cameras.free, late > 0)
        roots = [np.linalg.cholesky(i + 1e-12 * np.eye(len(i))).T for i in cameras.prior_information]
        prior = [root @ miss for root, miss in zip(roots, now.cameras.lenses - cameras.prior)]
        rows = residuals_of(seen, now) / np.sqrt(seen.variances)[:, None]
        return np.concatenate([rows.ravel(), *prior, (now.shifts / np.where(late > 0, late, 1.0))[late > 0]])

    scales = np.full(size, STEP)
    columns = []
    for k in range(size):
        step = np.zeros(size)
        step[k] = scales[k]
        columns.append((stacked(step) - stacked(-step)) / (2 * scales[k]))
    jacobian = np.stack(columns, axis=1)
    norm = np.linalg.norm(jacobian, axis=0)
    dense = np.linalg.inv((jacobian / norm).T @ (jacobian / norm)) / np.outer(norm, norm)
    covariance, index = covariance_of(seen, state)
    count = len(covariance)
    deviations = np.sqrt(np.diag(dense)[:count])
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), deviations, rtol=2e-3)
    scaled = (covariance - dense[:count, :count]) / np.outer(deviations, deviations)
    assert np.abs(scaled).max() < 5e-3
    assert index[0, 0] == -1 and index.max() == count - 1


def test_the_solution_is_a_minimum(problem):
    seen, state = problem
    rng = np.random.default_rng(1)
    covariance, _ = covariance_of(seen, state)
    best = total_cost(seen, state, PLAIN)
    size = len(covariance) + POSE * len(state.targets.rotations)
    late = state.cameras.jitter[seen.cameras] > 0
    for _ in range(20):
        step = np.zeros(size + int(late.sum()))
        step[: len(covariance)] = 0.5 * rng.normal(size=len(covariance)) * np.sqrt(np.diag(covariance))
        assert total_cost(seen, perturbed(state, step, state.cameras.free, late), PLAIN) > best
