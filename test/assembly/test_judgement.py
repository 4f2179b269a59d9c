"""The compiled loops against numpy."""

import captures
import numpy as np
from seen_views import observations

from panoptic_ros.assembly.judgement import (
    AcceptanceCriteria,
    JointEstimates,
    judge_joints,
    kept_people,
    second_skeletons,
)
from panoptic_ros.assembly.residuals import residuals_to_learn
from panoptic_ros.solving.joint_records import SolvedJoints
from panoptic_ros.solving.scene import CameraPoses

PEOPLE, JOINTS, VIEWS, ROWS = 4, 6, 5, 9
CAMERAS = captures.RIG.cameras
STANDARDS = AcceptanceCriteria(1.1, 0.8, 1e3)


def solved(seed):
    """Random joints: positions, lower normals, residuals, picks, and the scores of the observations."""
    rng = np.random.default_rng(seed)
    factor = rng.standard_normal((PEOPLE, JOINTS, 4, 3)) * [300.0, 100.0, 20.0]
    normals = np.swapaxes(factor, -1, -2) @ factor
    positions = rng.uniform(-1.0, 1.0, (PEOPLE, JOINTS, 3))
    positions[rng.random((PEOPLE, JOINTS)) < 0.2] = np.nan
    residuals = np.abs(rng.standard_normal((PEOPLE, JOINTS, VIEWS)))
    residuals[rng.random(residuals.shape) < 0.3] = -1.0
    picks = np.stack(
        [rng.integers(0, ROWS, residuals.shape), rng.integers(0, JOINTS, residuals.shape)], axis=-1
    )
    picks[(residuals < 0.0) & (rng.random(residuals.shape) < 0.5)] = -1
    return positions, np.tril(normals), residuals, picks, rng.uniform(0.0, 1.0, (ROWS, JOINTS))


def marked(scores):
    """With tails of noise that is as it should be."""
    return scores, np.ones_like(scores)


def full(lower):
    """The symmetric matrix of a lower triangle, damped."""
    normal = lower + np.swapaxes(np.tril(lower, -1), -1, -2)
    return normal + 1e-9 * np.trace(normal, axis1=-2, axis2=-1)[..., None, None] * np.eye(3)


def test_covariances_are_inverse_normals_inflated():
    positions, normals, residuals, picks, scores = solved(0)
    there, used = np.isfinite(positions[..., 0]), residuals >= 0.0
    unused = np.arange(JOINTS) % 3
    joints = SolvedJoints(positions, normals, residuals, picks)
    result, good = judge_joints(joints, used.sum(-1) + unused, marked(scores), STANDARDS)
    views = np.where(there, used.sum(-1), 0)
    assert (good == there).all() and (result.views == views).all()
    factor = 1.1 * (1.0 + (0.8 + unused) / np.maximum(views - 1, 1))
    expected = np.linalg.inv(full(normals)) * factor[..., None, None]
    assert np.allclose(result.covariances[there], expected[there], rtol=1e-9, atol=0.0)
    assert np.isnan(result.covariances[~there]).all()
    chosen = np.where(used, scores[picks[..., 0], picks[..., 1]], 0.0)
    assert np.allclose(result.scores, np.where(there, chosen.sum(-1) / np.maximum(used.sum(-1), 1), 0.0))
    middle = float(np.median(np.sqrt(np.linalg.eigvalsh(expected[there])[:, -1])))
    _, good = judge_joints(joints, used.sum(-1) + unused, marked(scores), STANDARDS._replace(worst=middle))
    assert (good[there] == (np.sqrt(np.linalg.eigvalsh(expected[there])[:, -1]) <= middle)).all()


def test_covariances_of_two_views_grow_by_the_tails_of_both_where_no_other_view_shows_the_joint():
    positions, normals, residuals, picks, scores = solved(1)
    tails = np.random.default_rng(2).uniform(1.0, 4.0, scores.shape)
    joints, shown = SolvedJoints(positions, normals, residuals, picks), (residuals >= 0.0).sum(-1)
    shown[::2] += 1  # a view that disagrees
    plain, _ = judge_joints(joints, shown, marked(scores), STANDARDS)
    grown, _ = judge_joints(joints, shown, (scores, tails), STANDARDS)
    few = (plain.views == 2) & (shown == 2)
    used = residuals[few] >= 0.0
    squares = np.where(used, tails[picks[few][..., 0], picks[few][..., 1]] ** 2, 0.0).sum(-1) / 2.0
    assert few.any() and np.allclose(grown.covariances[few], squares[:, None, None] * plain.covariances[few])
    many = shown > 2
    assert np.array_equal(grown.covariances[many], plain.covariances[many], equal_nan=True)


def test_singular_normals_give_no_joint():
    joints = SolvedJoints.nothing(1, 1, 2)._replace(positions=np.zeros((1, 1, 3)))
    nobody = np.zeros((1, 1), np.int64)
    result, good = judge_joints(joints, nobody, marked(np.ones((1, 1))), STANDARDS)
    assert not good.any() and np.isnan(result.positions).all() and np.isnan(result.covariances).all()


def test_people_need_a_joint():
    places = np.arange(6.0)[:, None] * np.ones(3) + 10.0 * np.arange(4.0)[:, None, None]
    good = np.ones((4, 6), bool)
    good[1] = False  # no joint
    good[2, :1] = False
    places[~good] = np.nan
    places[3], good[3] = 30.0, False  # at nodes, without 2D poses
    joints = JointEstimates.nothing(4, 6)._replace(positions=places)
    member = np.zeros((4, 2), np.int64)
    member[3] = -1
    assert kept_people(joints, good, member).tolist() == [0, 2, 3]


def test_of_two_skeletons_in_one_place_that_of_more_views_stays():
    person = np.random.default_rng(0).uniform(0.0, 1.0, (1, 6, 3))
    positions = np.concatenate([person + 0.05, person, person + 3.0, person])
    views = np.array([2, 3, 3, 3])[:, None] * np.ones((4, 6), np.int64)
    assert second_skeletons(positions, views).tolist() == [True, False, False, True]


def test_residuals_to_learn_have_leverage_taken_out():
    positions, normals, residuals, picks, precision = solved(1)
    precision = 100.0 * precision
    rng = np.random.default_rng(2)
    plane = rng.standard_normal((ROWS, JOINTS, 2))
    rotations, _ = np.linalg.qr(rng.standard_normal((VIEWS, 3, 3)))
    translations, focals = rng.uniform(3.0, 5.0, (VIEWS, 3)), rng.uniform(800.0, 900.0, VIEWS)
    kept, delays = np.array([0, 2, 3]), rng.uniform(-0.02, 0.02, (ROWS, JOINTS))
    shifts = rng.standard_normal(positions.shape)
    seen = observations(
        plane,
        precision,
        np.zeros(ROWS, int),
        np.zeros(VIEWS + 1, int),
        CameraPoses(rotations, translations, np.zeros(VIEWS)),
    )
    rows, joints, pixels = residuals_to_learn(
        kept,
        SolvedJoints(positions, normals, residuals, picks),
        shifts,
        seen._replace(delays=delays),
        focals,
    )
    expected = []
    for p in kept:
        for j in np.flatnonzero(np.isfinite(positions[p, :, 0]) & ((residuals[p] >= 0.0).sum(-1) >= 3)):
            for v in np.flatnonzero(picks[p, j, :, 0] >= 0):
                d, s = picks[p, j, v]
                local = rotations[v] @ (positions[p, j] + delays[d, s] * shifts[p, j]) + translations[v]
                point = local[:2] / local[2]
                jacobian = (rotations[v, :2] - point[:, None] * rotations[v, 2]) / local[2]
                spread = jacobian @ np.linalg.inv(full(normals[p, j])) @ jacobian.T
                leverage = 0.5 * np.trace(spread) * precision[d, s] ** 2 * (residuals[p, j, v] >= 0.0)
                if leverage < 0.7:
                    error = np.linalg.norm(plane[d, s] - point) * focals[v]
                    expected.append((d, s, error / np.sqrt(max(1.0 - leverage, 0.1))))
    expected = np.array(expected)
    assert len(rows) == len(expected) > 20
    assert (np.stack([rows, joints], axis=1) == expected[:, :2]).all()
    assert np.allclose(pixels, expected[:, 2])
