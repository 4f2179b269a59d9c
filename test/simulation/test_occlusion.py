"""What hides what."""

from __future__ import annotations

import numpy as np

from panoptic_ros.simulation.detector import hidden_joints, segment_distances, under_table
from panoptic_ros.simulation.people import draw_person
from panoptic_ros.simulation.skeleton import JOINTS, J


def test_segment_distances_against_sampling():
    rng = np.random.default_rng(0)
    origin, points, starts, ends = (rng.normal(size=(1, n, 3)) for n in (1, 6, 7, 7))
    exact = segment_distances(origin[:, 0], points, starts, ends)[0]
    share = np.linspace(0.0, 1.0, 300)[:, None, None]
    first = origin[0] + share * (points[0] - origin[0])
    second = starts[0] + share * (ends[0] - starts[0])
    for n in range(6):
        for k in range(7):
            gaps = np.linalg.norm(first[:, None, n] - second[None, :, k], axis=-1)
            assert abs(exact[n, k] - gaps.min()) < 0.01


def test_parallel_segments_have_a_distance():
    origin, far = np.zeros((1, 3)), np.array([[[4.0, 0.0, 0.0]]])
    starts, ends = np.array([[[1.0, 0.5, 0.0]]]), np.array([[[2.0, 0.5, 0.0]]])
    assert np.isclose(segment_distances(origin, far, starts, ends)[0, 0, 0], 0.5)


def standing(x, y):
    """Joints (19, 3) of somebody who stands at x, y and looks along x."""
    person = draw_person(np.random.default_rng(1), 0, "stand", 1.75, 1e-6)
    joints = person.joints(np.zeros(1))[0]
    across = joints[J["lHip"]] - joints[J["rHip"]]
    angle = -np.arctan2(-across[0], across[1])
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    moved = (joints - joints[J["BodyCenter"]] * [1, 1, 0]) @ turn.T
    return moved + np.array([x, y, 0.0])


def hide(people, camera, table=0.0, present=None):
    joints = np.stack(people)[None]
    there = np.ones((1, len(people)), bool) if present is None else present
    return hidden_joints(np.array([camera]), joints, there, np.full(len(people), 1.75), table)[0]


def test_somebody_in_front_hides_somebody_behind():
    people = [standing(0.0, 0.0), standing(2.0, 0.0)]
    hidden = hide(people, [6.0, 0.0, 1.0])
    assert hidden[0].mean() > 0.5 and hidden[1].mean() < 0.4
    assert not hide(people, [0.0, 6.0, 1.0]).all(axis=1).any()
    absent = hide(people, [6.0, 0.0, 1.0], present=np.array([[True, False]]))
    assert absent[0].mean() < 0.4, "who is not there hides nothing"


def test_a_face_is_hidden_from_behind_and_seen_from_the_front():
    face = [J[name] for name in ("Nose", "lEye", "rEye")]
    assert not hide([standing(0.0, 0.0)], [5.0, 0.0, 1.6])[0, face].any()
    assert hide([standing(0.0, 0.0)], [-5.0, 0.0, 1.6])[0, face].all()


def test_a_table_hides_what_is_under_it():
    camera, points = np.array([[3.0, 0.0, 2.0]]), np.array([[[0.0, 0.0, 0.3], [0.0, 0.0, 0.9]]])
    assert under_table(camera, points, 0.8).tolist() == [[True, False]]
    knees = [J["lKnee"], J["rKnee"]]
    assert hide([standing(0.0, 0.0)], [2.0, 0.0, 3.0], table=1.0)[0, knees].all()
    assert len(JOINTS) == 19
