"""Lengths as measurements: the exact solution, its approximation, and which pairs are rigid."""

import captures
import numpy as np
import pytest
from free_cameras import FreeCapture

from panoptic_ros.continuous.bones import (
    PairDistances,
    instants,
    learn_lengths,
    pair_distances,
    rigid_pairs,
    step_with_lengths,
)
from panoptic_ros.continuous.follow import follow
from panoptic_ros.continuous.problem import CurveProblem, TrackRays, grid_over
from panoptic_ros.continuous.relaxation import relax
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.solving.frames import camera_frames

PAIRS = rigid_pairs(captures.SKELETON)
MIRROR = np.array(captures.SKELETON.mirror)


@pytest.fixture(scope="module")
def problem():
    capture = FreeCapture(seconds=1.6, noise_px=1.5)
    arrays = RigArrays.of(capture.rig)
    frames = camera_frames(capture.sets, arrays, captures.SKELETON)
    stamps = np.array([1e-9 * (frame.stamp_ns - frames[0].stamp_ns) for frame in frames])
    track = follow(frames, stamps, arrays, MIRROR)[0]
    rays = TrackRays.of(track.entries, frames, stamps, arrays, MIRROR)
    found = CurveProblem(rays, rays.stamps, arrays, grid_over(rays.stamps))
    found.solve()
    return found


def test_pairs_are_bones_and_those_within_head_and_torso():
    names = captures.SKELETON.joint_names
    pairs = {frozenset((names[a], names[b])) for a, b in PAIRS}
    assert {"lKnee", "lAnkle"} in pairs and {"lShoulder", "rHip"} in pairs and {"lEar", "rEye"} in pairs
    assert frozenset(("lShoulder", "lWrist")) not in pairs and len(pairs) == len(PAIRS)


def test_lengths_of_a_rigid_body_are_learnt(problem):
    learnt = learn_lengths(pair_distances(problem, problem.fit(), PAIRS))
    body = captures.person((0.0, 0.0), 0.0)
    truth = np.linalg.norm(body[PAIRS[:, 0]] - body[PAIRS[:, 1]], axis=1)
    assert np.abs(learnt.lengths - truth).max() < 0.008 and (learnt.weights > 0.0).all()


def test_a_pair_that_moves_is_soft_or_free():
    times = np.linspace(0.0, 10.0, 400)
    lengths = np.stack([0.3 + a * np.sin(times) for a in (0.0, 0.02, 0.2)])
    learnt = learn_lengths(PairDistances(lengths, np.full(lengths.shape, 1e-6)))
    assert learnt.weights[0] > 100.0 * learnt.weights[1] > 0.0 and learnt.weights[2] == 0.0


def test_lengths_bring_the_joints_to_their_distances(problem):
    fit = problem.fit()
    learnt = learn_lengths(pair_distances(problem, fit, PAIRS))

    def spread(points):
        changed = fit._replace(points=points)
        return np.std(pair_distances(problem, changed, PAIRS).lengths, axis=1).mean()

    exact, _ = step_with_lengths(problem, fit.points, PAIRS, learnt, problem.stiffness)
    assert spread(exact) < 0.6 * spread(fit.points)
    change = relax(fit.factors, fit.points, problem.grid, instants(problem), PAIRS, learnt, 60)
    np.testing.assert_allclose(fit.points + change, exact, atol=1e-6)
    few = relax(fit.factors, fit.points, problem.grid, instants(problem), PAIRS, learnt, 10)
    assert np.abs(fit.points + few - exact).mean() < 1e-4
