"""Derivatives against finite differences, and poses found again from exact data."""

import numpy as np
import pytest
from bodies import CHAIN, MODEL, D, S, cameras, moved, no_prior, placed, some_pose

from panoptic_ros.geometry.chain import (
    place_sites,
    step_between,
    turn_slopes,
)
from panoptic_ros.geometry.rotations import (
    from_quaternions,
    mean_rotation,
    rotations_of,
    to_quaternions,
    vectors_of,
)
from panoptic_ros.kinematics.pose.normal_equations import assemble
from panoptic_ros.kinematics.pose.prior import hinges_of
from panoptic_ros.kinematics.pose.solve import solve_pose
from panoptic_ros.kinematics.pose.targets import (
    NO_FLOOR,
    NO_POINTS,
    NO_TURNS,
    NO_VIEWS,
    Anchor,
    FloorPoints,
    OrientationTargets,
    PointTargets,
    PoseEvidence,
    PosePrior,
    ViewTargets,
    no_anchor,
)


def evidence_of(pose, seed=1, noise=0.0, kinds="vptfr"):
    """All kinds of targets, taken from a pose."""
    rng = np.random.default_rng(seed)
    frames, places = placed(pose)
    segments = np.arange(S)
    offsets = rng.normal(0, 0.05, (S, 3))
    points = places + (frames @ offsets[..., None])[..., 0] + noise * rng.normal(size=(S, 3))
    rotations, translations = cameras()
    rows = [(s, k) for s in range(S) for k in range(4)]
    seg, cam = np.array(rows).T
    local = (rotations[cam] @ points[seg][..., None])[..., 0] + translations[cam]
    views = ViewTargets(
        seg,
        offsets[seg],
        cam,
        local[:, :2] / local[:, 2:] + noise * rng.normal(size=(len(seg), 2)),
        np.full(len(seg), 1e4),
        9.0,
        rotations,
        translations,
    )
    spread = rng.normal(size=(S, 3, 3))
    goals = rotations_of(noise * rng.normal(size=(S, 3))) @ frames
    prior = rng.normal(size=(3 * S - 3, 8))
    poses = PosePrior(
        0.1 * rng.normal(size=3 * S - 3),
        0.1 * prior @ prior.T,
        0.02 * np.eye(3 * S - 3),
        np.full(3 * S - 3, -0.3),
        np.full(3 * S - 3, 0.3),
        0.7,
        1.0,
        0.3,
        1.0,
        2.0,
        hinges_of(MODEL, 0.1),
    )
    return PoseEvidence(
        views if "v" in kinds else NO_VIEWS,
        PointTargets(segments, offsets, points, spread @ spread.swapaxes(1, 2) + np.eye(3), 2.0)
        if "p" in kinds
        else NO_POINTS,
        OrientationTargets(segments, goals, np.full(S, 5.0), 3.0) if "t" in kinds else NO_TURNS,
        FloorPoints(segments[-8:], 1.0, 3.0) if "f" in kinds else NO_FLOOR,
        poses if "r" in kinds else no_prior(S),
        0.7,
    )


@pytest.mark.parametrize("kinds", ["v", "p", "t", "f", "r", "vptfr"])
def test_gradient_is_that_of_the_cost(kinds):
    evidence = evidence_of(some_pose(), noise=0.1, kinds=kinds)
    pose = some_pose(2)
    rng = np.random.default_rng(3)
    spread = rng.normal(size=(D, D))
    anchor = Anchor(some_pose(2).root, some_pose(2).turns, spread @ spread.T, rng.normal(size=D), 0.1)
    hessian, gradient, scratch = np.empty((D, D)), np.empty(D), np.empty(D)
    assemble(CHAIN, pose, evidence, anchor, hessian, gradient)
    for i in range(D):
        step = np.zeros(D)
        step[i] = 1e-6
        ahead = assemble(CHAIN, moved(pose, step), evidence, anchor, np.empty((D, D)), scratch)
        behind = assemble(CHAIN, moved(pose, -step), evidence, anchor, np.empty((D, D)), scratch)
        assert (ahead - behind) / 4e-6 == pytest.approx(gradient[i], rel=2e-4, abs=2e-4)


def test_second_derivatives_are_those_of_exact_data():
    """Where all residuals are 0, Gauss-Newton's matrix is the second derivative."""
    pose = some_pose()
    evidence = evidence_of(pose, kinds="vpt")
    hessian, gradient, ahead, behind = np.empty((D, D)), np.empty(D), np.empty(D), np.empty(D)
    nothing = no_anchor(S)
    assemble(CHAIN, pose, evidence, nothing, hessian, gradient)
    np.testing.assert_allclose(gradient, 0, atol=1e-8)
    np.testing.assert_allclose(hessian, hessian.T)
    for i in range(0, D, 5):
        step = np.zeros(D)
        step[i] = 1e-5
        assemble(CHAIN, moved(pose, step), evidence, nothing, np.empty((D, D)), ahead)
        assemble(CHAIN, moved(pose, -step), evidence, nothing, np.empty((D, D)), behind)
        np.testing.assert_allclose((ahead - behind) / 2e-5, hessian[i], atol=2e-3 * abs(hessian).max())


def test_slopes_of_sites_and_orientations_are_finite_differences():
    pose, rng = some_pose(4), np.random.default_rng(5)
    segments, offsets = np.arange(S), rng.normal(0, 0.1, (S, 3))
    slopes, turned = np.empty((S, 3, D)), np.empty((S, 3, D))
    places = place_sites(CHAIN, pose, segments, offsets, slopes)
    frames = turn_slopes(CHAIN, pose, segments, turned)
    scratch = np.empty((S, 3, D))
    for i in range(D):
        step = np.zeros(D)
        step[i] = 1e-6
        there = moved(pose, step)
        found = (place_sites(CHAIN, there, segments, offsets, scratch) - places) / 1e-6
        np.testing.assert_allclose(found, slopes[..., i], atol=2e-5)
        apart = turn_slopes(CHAIN, there, segments, scratch) @ frames.swapaxes(1, 2)
        np.testing.assert_allclose(vectors_of(apart) / 1e-6, turned[..., i], atol=2e-5)


def test_a_pose_is_found_again():
    goal = some_pose(6, 0.3)
    pose = moved(goal, np.random.default_rng(7).normal(0, 0.15, D))
    solve_pose(CHAIN, pose, evidence_of(goal, kinds="vt"), no_anchor(S), 30, np.empty((D, D)))
    np.testing.assert_allclose(placed(pose)[1], placed(goal)[1], atol=1e-4)
    np.testing.assert_allclose(placed(pose)[0], placed(goal)[0], atol=1e-3)


def test_one_far_outlier_moves_nothing():
    goal = some_pose(8, 0.3)
    evidence = evidence_of(goal, kinds="vt")
    evidence.views.points[13] += 0.5
    pose = goal.copy()
    solve_pose(CHAIN, pose, evidence, no_anchor(S), 30, np.empty((D, D)))
    assert abs(placed(pose)[1] - placed(goal)[1]).max() < 0.005


def test_what_nothing_determines_stays():
    pose = some_pose(9)
    before = pose.copy()
    solve_pose(CHAIN, pose, evidence_of(pose, kinds="t"), no_anchor(S), 10, np.empty((D, D)))
    np.testing.assert_allclose(pose.root, before.root, atol=1e-9)


def test_rotations_and_their_vectors():
    rng = np.random.default_rng(10)
    vectors = rng.normal(size=(200, 3))
    vectors *= (np.r_[np.linspace(0, np.pi - 1e-9, 199), 1e-9] / np.linalg.norm(vectors, axis=1))[:, None]
    rotations = rotations_of(vectors)
    np.testing.assert_allclose(
        rotations @ rotations.swapaxes(1, 2), np.tile(np.eye(3), (200, 1, 1)), atol=1e-12
    )
    back = vectors_of(rotations)
    np.testing.assert_allclose(rotations_of(back), rotations, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(back, axis=1), np.linalg.norm(vectors, axis=1), atol=1e-5)
    np.testing.assert_allclose(from_quaternions(to_quaternions(rotations)), rotations, atol=1e-6)
    np.testing.assert_allclose(mean_rotation(rotations[:1]), rotations[0], atol=1e-9)


def test_a_step_leads_from_one_pose_to_another():
    begin, end, step = some_pose(11), some_pose(12), np.empty(D)
    step_between(begin, end, step)
    np.testing.assert_allclose(moved(begin, step).turns, end.turns, atol=1e-9)
