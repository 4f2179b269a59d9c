"""Prior of joints that share a motion: free shares, rigid parts, and ellipsoids of slow cameras."""

from dataclasses import replace

import captures
import numpy as np
import pytest
from free_cameras import FreeCapture

from panoptic_ros.continuous.bones import LearntLengths, rigid_pairs
from panoptic_ros.continuous.config import ContinuousConfig
from panoptic_ros.continuous.curves import jerk_weights
from panoptic_ros.continuous.passes import ContinuousPass
from panoptic_ros.continuous.rigid_motion import free_shares, rigid_parts
from panoptic_ros.geometry.splines import spline
from panoptic_ros.simulation.free_running import FreeRunning, simulate_free_running
from panoptic_ros.simulation.free_running_scenes import FREE_RUNNING_SCENES
from panoptic_ros.simulation.rigs import Ring
from panoptic_ros.stage import untold
from panoptic_ros.study.continuous.figures import figures_of
from panoptic_ros.study.continuous.methods import METHODS, CaptureUnderTest

PAIRS = np.array([(a, b) for a in range(4) for b in range(a)] + [(4, 3)])
POSE = np.random.default_rng(3).normal(size=(6, 1, 3))


def shares_of_dense_system(stiffness, learnt, knots=60):
    """Return the free shares (6,) from the covariance of the third differences of all control points.

    The first three control points are known, so the third differences are the unknowns.
    """
    points = np.zeros((knots, knots - 3))  # control points as sums of third differences
    scale = jerk_weights(0.04)
    for k in range(3, knots):
        points[k] = -sum(scale[p] * points[k - 3 + p] for p in range(3))
        points[k, k - 3] += 1.0
        points[k] /= scale[3]
    times = np.arange(0.0, (knots - 4) * 0.04, 0.02)
    curve = spline(0.0, 0.04, points)(times)
    gaps = (POSE[PAIRS[:, 0]] - POSE[PAIRS[:, 1]])[:, 0]
    gaps /= np.linalg.norm(gaps, axis=1, keepdims=True)
    ends = np.zeros((len(PAIRS), 6))
    ends[np.arange(len(PAIRS)), PAIRS[:, 0]], ends[np.arange(len(PAIRS)), PAIRS[:, 1]] = 1.0, -1.0
    rows = np.einsum("pj,pa,tk->ptjak", ends, np.sqrt(learnt.weights)[:, None] * gaps, curve)
    rows = rows.reshape(len(PAIRS) * len(times), -1)
    prior = np.repeat(stiffness, 3 * (knots - 3))
    covariance = np.linalg.inv(np.diag(prior) + rows.T @ rows)
    shares = (prior * np.diag(covariance)).reshape(6, 3, knots - 3)
    return shares[..., 20:-20].mean(axis=(1, 2))


@pytest.mark.parametrize("weight", [30.0, 1e3, 3e4])
def test_free_shares_are_those_of_the_whole_system(weight):
    stiffness = np.array([1e4, 2e4, 5e4, 1e4, 1e3, 1e4])
    learnt = LearntLengths(np.ones(7), np.full(7, weight), np.zeros(7))
    shares = free_shares(np.repeat(POSE, 60, axis=1), PAIRS, learnt, np.repeat(stiffness[:, None], 57, 1))
    np.testing.assert_allclose(shares, shares_of_dense_system(stiffness, learnt), atol=0.03)
    assert shares[5] == 1.0


def test_a_rigid_part_is_free_to_move_in_six_ways():
    learnt = LearntLengths(np.ones(7), np.full(7, 1e12), np.zeros(7))
    shares = free_shares(np.repeat(POSE, 60, axis=1), PAIRS, learnt, np.ones((6, 57)))
    # four joints of a rigid part, one joint on a bone, and a free one
    assert 3.0 * shares.sum() == pytest.approx(6.0 + 2.0 + 3.0, abs=0.01)


def test_head_and_torso_are_rigid_parts_and_limbs_are_none():
    names = captures.SKELETON.joint_names
    parts = rigid_parts(rigid_pairs(captures.SKELETON), len(names))
    np.testing.assert_allclose(parts.sum(axis=1), 1.0)
    hip, shoulder, knee, ankle = (names.index(n) for n in ("lHip", "rShoulder", "lKnee", "lAnkle"))
    assert parts[hip, shoulder] == parts[hip, hip] and parts[hip, knee] == 0.0
    assert parts[ankle, ankle] == parts[knee, knee] == 1.0


@pytest.mark.parametrize(("cameras", "least"), [(3, 0.88), (11, 0.93)])
def test_ellipsoids_of_a_runner_before_slow_cameras(cameras, least):
    scene = replace(
        FREE_RUNNING_SCENES["faster"],
        name="slow cameras",
        rig=Ring(cameras, radius=5.0),
        timing=FreeRunning((6.4,)),
        seconds=5.0,
    )
    capture = simulate_free_running(scene, 1)
    times = np.arange(1, 500) / 100.0
    found = METHODS["continuous"](CaptureUnderTest(capture, times, ContinuousConfig()))
    figures = figures_of(capture, times, found.frames)
    assert least < figures["in_ellipsoid"] < 0.99


def test_lengths_refute_false_rays_that_nothing_else_contradicts():
    """At 18 views a second, a curve follows a ray that is 60 px off."""

    def spoil(pixels, rng, camera):
        wild = rng.random(pixels.shape[:2]) < 0.03
        pixels[wild] += rng.normal(0.0, 60.0, (int(wild.sum()), 2))

    capture = FreeCapture(cameras=3, rate=6.0, speed=2.0, spoil=spoil)
    motion = ContinuousPass(ContinuousConfig(), capture.context).run(capture.recording, untold)
    errors = capture.errors(motion, np.arange(0.3, 3.7, 0.013))
    assert np.isfinite(errors).all() and errors.mean() < 0.028 and errors.max() < 1.0
