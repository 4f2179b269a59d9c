"""Lengths are found again from joints that are seen exactly, whatever the pose."""

import numpy as np
import pytest
from bodies import BODY, CHAIN, MODEL, D, S, cameras, some_pose

from panoptic_ros.geometry.chain import place_sites
from panoptic_ros.geometry.segment_chain import Chain
from panoptic_ros.kinematics.body.lengths import LENGTH_SD, LengthEstimate, lengths_of
from panoptic_ros.kinematics.pose.solve import solve_pose
from panoptic_ros.kinematics.pose.targets import (
    NO_FLOOR,
    NO_POINTS,
    NO_TURNS,
    NO_VIEWS,
    Evidence,
    PointTargets,
    ViewTargets,
    no_anchor,
    no_prior,
)


def exact_views(chain, pose):
    rng = np.random.default_rng(5)
    seg, cam = np.array([(s, k) for s in range(S) for _ in range(3) for k in range(4)]).T
    offsets = np.repeat(rng.normal(0, 0.05, (3 * S, 3)), 4, axis=0)
    points = place_sites(chain, pose, seg, offsets, np.empty((len(seg), 3, D)))
    rotations, translations = cameras()
    local = (rotations[cam] @ points[..., None])[..., 0] + translations[cam]
    plane = local[:, :2] / local[:, 2:]
    views = ViewTargets(seg, offsets, cam, plane, np.full(len(seg), 1e6), 9.0, rotations, translations)
    return Evidence(views, NO_POINTS, NO_TURNS, NO_FLOOR, no_prior(S), 1.0)


def exact_points(chain, pose):
    views, *_ = exact_views(chain, pose)
    segments, offsets = views.segments[::4], views.offsets[::4]
    goals = place_sites(chain, pose, segments, offsets, np.empty((len(segments), 3, D)))
    points = PointTargets(segments, offsets, goals, np.tile(1e6 * np.eye(3), (len(segments), 1, 1)), 9.0)
    return Evidence(NO_VIEWS, points, NO_TURNS, NO_FLOOR, no_prior(S), 1.0)


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
