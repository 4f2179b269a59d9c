"""The 2D person of each view that a skeleton was made of."""

import numpy as np
from fed_stages import FedAssembly

from panoptic_ros.solving.joint_records import main_people

NO_PICKS = np.zeros((0, 19, 3, 2), np.int64)


def solve(scenes, rig, item):
    return FedAssembly(scenes.context(rig)).step(item).outputs[0]


def of_person(pose, truth):
    """The 2D people (V,) of the skeleton that is nearest to somebody."""
    return pose.sources.persons[np.nanmean(np.linalg.norm(pose.positions - truth, axis=-1), axis=1).argmin()]


def test_exchanged_sides_are_the_same_2d_person(scenes):
    rig, people = scenes.ring(5), [scenes.person(0.5, 0.4), scenes.person(-0.6, 0, turn=1.0)]
    arms = [scenes.skeleton.joint(s + n) for n in ("Shoulder", "Elbow", "Wrist") for s in "lr"]

    def change(i, points, scores):
        if i == 1:
            points[0] = points[0, list(scenes.skeleton.mirror)]
        if i == 3:
            points[1, arms] = points[1, [scenes.skeleton.mirror[j] for j in arms]]

    pose = solve(scenes, rig, scenes.proposals(rig, people, change=change))
    assert of_person(pose, people[0]).tolist() == [0] * 5
    assert of_person(pose, people[1]).tolist() == [1] * 5


def test_an_arm_in_somebody_elses_2d_person_does_not_count(scenes):
    rig, people = scenes.ring(6), [scenes.person(0.25, 0.0), scenes.person(-0.3, 0.1)]

    def change(i, points, scores):
        if i == 2:
            points[[0, 1], 4], points[[0, 1], 5] = points[[1, 0], 4], points[[1, 0], 5]

    pose = solve(scenes, rig, scenes.proposals(rig, people, change=change))
    assert of_person(pose, people[0]).tolist() == [0] * 6
    assert of_person(pose, people[1]).tolist() == [1] * 6


def test_a_view_that_does_not_show_somebody_has_no_index(scenes):
    rig, people = scenes.ring(5), [scenes.person(0.5, 0.4), scenes.person(-0.6, 0)]

    def change(i, points, scores):
        if i == 3:
            points[0], scores[0] = np.nan, 0.0

    pose = solve(scenes, rig, scenes.proposals(rig, people, change=change))
    assert of_person(pose, people[0]).tolist() == [0, 0, 0, -1, 0]
    assert of_person(pose, people[1]).tolist() == [1] * 5


def test_the_2d_person_that_gave_most_joints_wins_and_association_at_a_tie():
    starts = np.array([0, 2, 4, 4])  # two 2D people, two, none
    member = np.array([[0, 2, -1], [1, -1, -1]])
    residuals = np.full((2, 4, 3), -1.0)
    picks = np.full((2, 4, 3, 2), -1)
    for person, joint, view, row in [
        (0, 0, 0, 0),
        (0, 1, 0, 1),
        (0, 2, 0, 1),  # two of three joints from the other one
        (0, 0, 1, 3),
        (0, 1, 1, 2),  # a tie
        (1, 3, 1, 3),  # one joint of a view where association found nobody
    ]:
        residuals[person, joint, view], picks[person, joint, view] = 0.5, (row, joint)
    assert main_people(starts, member, residuals, picks).tolist() == [[1, 2, -1], [1, -1, -1]]


def test_nobody_and_no_views():
    none = np.zeros((0, 3), np.int64)
    assert main_people(np.zeros(4, int), none, np.zeros((0, 19, 3)), NO_PICKS).shape == (0, 3)
    empty = np.zeros((0, 0), np.int64)
    assert main_people(np.zeros(1, int), empty, np.zeros((0, 19, 0)), NO_PICKS[:, :, :0]).size == 0
