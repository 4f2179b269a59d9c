"""Lengths are found again from joints that are seen exactly, whatever the pose.

Lengths go over to others smoothly, and arrive.
"""

import numpy as np
import pytest
from bodies import BODY, CHAIN, MODEL, D, S, cameras, no_prior, some_pose

from panoptic_ros.geometry.chain import place_sites
from panoptic_ros.geometry.segment_chain import Chain
from panoptic_ros.kinematics.body.lengths import (
    LASTS_S,
    LENGTH_SD,
    LengthEstimate,
    LengthTransition,
    lengths_of,
)
from panoptic_ros.kinematics.pose.solve import solve_pose
from panoptic_ros.kinematics.pose.targets import (
    NO_FLOOR,
    NO_POINTS,
    NO_TURNS,
    NO_VIEWS,
    PointTargets,
    PoseEvidence,
    ViewTargets,
    no_anchor,
)

PERIOD = 1.0 / 60.0


def exact_views(chain, pose):
    rng = np.random.default_rng(5)
    seg, cam = np.array([(s, k) for s in range(S) for _ in range(3) for k in range(4)]).T
    offsets = np.repeat(rng.normal(0, 0.05, (3 * S, 3)), 4, axis=0)
    points = place_sites(chain, pose, seg, offsets, np.empty((len(seg), 3, D)))
    rotations, translations = cameras()
    local = (rotations[cam] @ points[..., None])[..., 0] + translations[cam]
    plane = local[:, :2] / local[:, 2:]
    views = ViewTargets(seg, offsets, cam, plane, np.full(len(seg), 1e6), 9.0, rotations, translations)
    return PoseEvidence(views, NO_POINTS, NO_TURNS, NO_FLOOR, no_prior(S), 1.0)


def exact_points(chain, pose):
    views, *_ = exact_views(chain, pose)
    segments, offsets = views.segments[::4], views.offsets[::4]
    goals = place_sites(chain, pose, segments, offsets, np.empty((len(segments), 3, D)))
    points = PointTargets(segments, offsets, goals, np.tile(1e6 * np.eye(3), (len(segments), 1, 1)), 9.0)
    return PoseEvidence(NO_VIEWS, points, NO_TURNS, NO_FLOOR, no_prior(S), 1.0)


@pytest.mark.parametrize("exact", [exact_views, exact_points])
def test_lengths_are_found_again(exact):
    rng = np.random.default_rng(6)
    true = Chain(CHAIN.parents, BODY.offsets.copy())
    for length, scale in zip(lengths_of(MODEL), rng.normal(0, 0.05, 20)):
        for s, axis in length:
            true.offsets[s, axis] *= np.exp(scale)
    chain = Chain(CHAIN.parents, BODY.offsets.copy())
    estimate = LengthEstimate(MODEL, BODY.offsets)
    for _ in range(4):
        for n in range(5):
            goal = some_pose(10 + n, 0.3)
            evidence, pose = exact(true, goal), goal.copy()
            solve_pose(chain, pose, evidence, no_anchor(S), 20, np.empty((D, D)))
            estimate.look(chain, pose, evidence)
        estimate.update()
        chain.offsets[:] = estimate.offsets()
    lengths = [np.linalg.norm(offsets, axis=1) for offsets in (chain.offsets, true.offsets, BODY.offsets)]
    assert abs(lengths[0] - lengths[1]).max() < 0.25 * abs(lengths[2] - lengths[1]).max()


def test_left_and_right_grow_together():
    parts = [{(MODEL.names[s], axis) for s, axis in length} for length in lengths_of(MODEL)]
    assert {("lShin", 2), ("rShin", 2)} in parts
    assert {(f"spine{k}", 2) for k in range(1, 5)} in parts


def test_lengths_that_are_not_known_are_in_the_covariances_of_places():
    rng, errors, stated = np.random.default_rng(7), [], []
    for _ in range(30):
        true = Chain(CHAIN.parents, BODY.offsets.copy())
        for length in lengths_of(MODEL):
            scale = np.exp(rng.normal(0, LENGTH_SD))
            for s, axis in length:
                true.offsets[s, axis] *= scale
        chain, goal = Chain(CHAIN.parents, BODY.offsets.copy()), some_pose(11, 0.3)
        evidence, pose = exact_points(true, goal), goal.copy()
        evidence = evidence._replace(points=evidence.points._replace(scale=0.0))
        solve_pose(chain, pose, evidence, no_anchor(S), 30, np.empty((D, D)))
        estimate = LengthEstimate(MODEL, BODY.offsets)
        estimate.look(chain, pose, evidence)
        errors.append(placed_by(chain, pose) - placed_by(true, goal))
        stated.append(np.trace(estimate.spreads(), axis1=1, axis2=2))
    assert np.sqrt(np.mean(stated)) == pytest.approx(np.sqrt(np.square(errors).sum(-1).mean()), rel=0.15)


def placed_by(chain, pose):
    return place_sites(chain, pose, np.arange(S), np.zeros((S, 3)), np.empty((S, 3, D)))


def test_lengths_begin_where_they_were_and_end_where_they_are_to_be():
    begin = 0.9 * BODY.offsets
    change = LengthTransition(begin, BODY)
    steps = round(LASTS_S / PERIOD) + 2
    found = np.array([begin, *(change.after(PERIOD).offsets for _ in range(steps))])
    assert change.is_over and np.array_equal(found[-1], BODY.offsets)
    moved = np.linalg.norm(np.diff(found, axis=0), axis=-1)
    assert (moved.sum(0) <= np.linalg.norm(BODY.offsets - begin, axis=-1) + 1e-12).all(), "straight on"
    jumps = np.linalg.norm(np.diff(found, 2, axis=0), axis=-1) / PERIOD**2
    slow = np.pi**2 / (2.0 * LASTS_S**2) * np.linalg.norm(BODY.offsets - begin, axis=-1)
    assert (jumps <= 1.05 * slow + 1e-9).all(), "as half a cosine accelerates"


def test_what_the_detector_sees_of_the_new_body_is_kept():
    found = LengthTransition(BODY.offsets, BODY).after(0.1)
    assert found.keypoints is BODY.keypoints and found.own == BODY.own
