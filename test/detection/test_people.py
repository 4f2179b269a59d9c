import numpy as np

from panoptic_ros.detection.people import (
    DetectedPeople,
    boxes_of_points,
    concatenate,
    no_people,
    without_duplicates,
)


def people(points, scores=None):
    points = np.asarray(points, float)
    count = len(points)
    boxes = boxes_of_points(points, np.ones(points.shape[:2], bool))
    return DetectedPeople(points, np.ones(points.shape[:2]), np.linspace(0.9, 0.5, count), boxes)


BODY = np.array([[0.0, 0.0], [10.0, 50.0], [-10.0, 100.0], [0.0, 30.0]])
ALL = np.ones((3, 4), bool)


def test_who_is_found_twice_is_kept_once_the_better_one():
    found = people([BODY, BODY + 1.0, BODY + (60.0, 0.0)])
    assert without_duplicates(found, ALL, 0.7).tolist() == [0, 2]
    assert without_duplicates(found, ALL, 1.0).tolist() == [0, 1, 2]


def test_people_that_share_some_joints_are_two():
    half = BODY + np.array([[0, 0], [0, 0], [40, 0], [40, 0]])
    assert without_duplicates(people([BODY, half]), ALL[:2], 0.7).tolist() == [0, 1]


def test_only_joints_that_both_show_are_compared():
    seen = np.array([[True, True, False, False], [False, False, True, True]])
    assert without_duplicates(people([BODY, BODY]), seen, 0.7).tolist() == [0, 1]
    seen[1, :2] = True
    assert without_duplicates(people([BODY, BODY]), seen, 0.7).tolist() == [0]


def test_boxes_and_heights_follow_the_longer_side():
    found = people([BODY, BODY[:, ::-1] * 2])
    assert found.heights().tolist() == [100.0, 200.0]
    moved = found.transformed(np.array([[0.5, 0, 3], [0, 0.5, 4]]))
    assert moved.heights().tolist() == [50.0, 100.0]
    np.testing.assert_allclose(moved.boxes[0], [-2.0, 4.0, 8.0, 54.0])


def test_nobody():
    nobody = no_people(4)
    assert len(nobody) == 0 and len(concatenate([], 4)) == 0 and nobody.heights().shape == (0,)
    assert without_duplicates(nobody, np.zeros((0, 4), bool), 0.7).tolist() == []
