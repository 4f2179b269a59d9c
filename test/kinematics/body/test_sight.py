"""How far 2D people are off a body, against plain numpy."""

import numpy as np

from panoptic_ros.kinematics.body.sight import ExpectedJoints, distances, seen_joints

ROTATION, TRANSLATION = np.eye(3), np.array([0.1, -0.2, 4.0])


def people(seed=0):
    rng = np.random.default_rng(seed)
    places = rng.normal(0, 0.4, (6, 3))
    local = places + TRANSLATION
    plane = local[:, :2] / local[:, 2:]
    points = np.stack([plane, plane + [0.05, 0.0], np.full((6, 2), np.nan)])
    return places, local, points


def test_distance_is_the_median_length_at_the_depth_of_the_body():
    places, local, points = people()
    points[1, :2] = np.nan
    found = distances(points, np.arange(6), places, ROTATION, TRANSLATION)
    np.testing.assert_allclose(found[:2], [0.0, 0.05 * np.median(local[:, 2])], atol=1e-9)
    assert np.isinf(found[2])


def test_nobody_is_near_who_is_behind_the_camera():
    places, _, points = people()
    found = distances(points, np.arange(6), places - [0.0, 0.0, 9.0], ROTATION, TRANSLATION)
    assert np.isinf(found).all()


def test_joints_without_place_or_score_are_left_out():
    _, _, points = people()
    points, scores = points[:2].copy(), np.full((2, 6), 0.5)
    points[0, 4] = np.nan
    scores[1, 2] = 0.0
    columns = np.array([4, 2, 0])
    sites, views, seen, weights = seen_joints(points, scores, columns, np.array([8.0, 2.0]), 2.0)
    assert list(zip(sites, views)) == [(1, 0), (2, 0), (0, 1), (2, 1)]
    np.testing.assert_array_equal(seen, [points[v, columns[s]] for s, v in zip(sites, views)])
    np.testing.assert_allclose(weights, [2.0, 2.0, 0.5, 0.5])


def test_the_middle_of_who_is_seen_in_part_is_that_of_the_part():
    sites = ExpectedJoints(np.array([2, 0, 1]), np.array([[0.0, 0.0, 1.6], [0.0, 0.0, 1.0], [0.0, 0.0, 0.1]]))
    points = np.zeros((3, 2))
    points[1] = np.nan  # the lowest
    assert sites.middle[2] == 1.0
    assert sites.middle_seen({0: (points, np.ones(3))})[2] == 1.3
    assert sites.middle_seen({0: (points, np.ones(3)), 1: (np.zeros((3, 2)), np.ones(3))})[2] == 1.15
    assert sites.middle_seen({0: (np.full((3, 2), np.nan), np.zeros(3))})[2] == 1.0
