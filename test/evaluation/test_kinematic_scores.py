"""Whether true joints lie where bodies say that they are, and how large errors of known motions are."""

from dataclasses import replace

import numpy as np

from panoptic_ros.domain.subjects import BodyState
from panoptic_ros.evaluation.kinematic_scores import inside, score_bodies, score_joint_angles
from panoptic_ros.geometry.rotations import rotations_of
from panoptic_ros.io.body_models import read_body_model

RNG = np.random.default_rng(0)


def body(number, x, stamp=0):
    places = np.zeros((21, 3)) + [x, 0.0, 1.0]
    return BodyState(stamp, number, places, np.tile(np.eye(3), (21, 1, 1)))


def test_95_of_100_true_joints_lie_in_ellipsoids_of_the_true_spread():
    spread = np.array([0.01, 0.03, 0.1])
    truth = [body(0, 0.0, stamp) for stamp in range(200)]
    covariances = np.tile(np.diag(np.r_[spread, 1.0, 1.0, 1.0] ** 2), (21, 1, 1))
    found = [
        replace(state, places=state.places + spread * RNG.normal(size=(21, 3)), covariances=covariances)
        for state in truth
    ]
    assert abs(inside(found, truth) - 0.95) < 0.015
    assert np.isnan(inside(truth, truth))


def moved(states, turn, shift):
    """The same bodies, turned and shifted as a whole."""
    return [replace(s, places=s.places @ turn.T + shift, frames=turn @ s.frames) for s in states]


def walking():
    """Bodies of joints that lie apart and segments that turn."""
    found = []
    for stamp in range(8):
        vectors = RNG.normal(0.0, 0.4, (21, 3))
        frames = rotations_of(vectors)
        found.append(BodyState(stamp * 10**8, 0, RNG.normal(0.0, 0.5, (21, 3)), frames))
    return found


def test_a_rigid_motion_of_all_is_no_error_after_procrustes():
    truth, model = walking(), read_body_model()
    turn = rotations_of(np.array([[0.0, 0.0, np.radians(20.0)]]))[0]
    shift = np.array([0.03, 0.04, 0.0])
    scores = score_bodies(truth, moved(truth, turn, shift), model.parents, 0.0)
    assert abs(scores["deg"] - 20.0) < 1e-6 and abs(scores["deg_std"]) < 1e-6
    assert scores["mm"] > 50.0 and scores["relative_mm"] > 50.0
    assert scores["procrustes_mm"] < 1e-6 and scores["procrustes_deg"] < 1e-5
    assert scores["joint_deg"] < 1e-5
    assert score_joint_angles(truth, moved(truth, turn, shift), model, 0.0)["angle_deg"] < 1e-6


def test_constant_errors_in_the_frame_of_each_segment_vanish_by_alignment():
    truth, model = walking(), read_body_model()
    offsets, turns = RNG.normal(0.0, 0.02, (21, 3)), rotations_of(RNG.normal(0.0, 0.1, (21, 3)))
    found = [
        replace(s, places=s.places + (s.frames @ offsets[..., None])[..., 0], frames=s.frames @ turns)
        for s in truth
    ]
    scores = score_bodies(truth, found, model.parents, 0.0)
    lengths = 1000 * np.linalg.norm(offsets, axis=-1)
    assert np.isclose(scores["mm"], lengths.mean()) and np.isclose(scores["mm_median"], np.median(lengths))
    assert np.isclose(scores["mm_std"], lengths.std())
    assert np.isclose(scores["mm_mad"], np.median(np.abs(lengths - np.median(lengths))))
    assert scores["aligned_mm"] < 1e-6 and scores["aligned_deg"] < 1e-5 < scores["deg"]
