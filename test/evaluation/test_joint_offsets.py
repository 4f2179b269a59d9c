"""Offsets of joints in segments, of made people whose offsets are known."""

import numpy as np
from bodies import MODEL
from scipy.spatial.transform import Rotation

from panoptic_ros.evaluation.joint_offsets import (
    FEWEST,
    MatchedSkeletons,
    corrected_joints,
    judge_joint_offsets,
    measure_joint_offsets,
)

NAMES = ("lShoulder", "rShoulder", "lHip", "rHip", "Nose")
OFFSETS = {
    "lShoulder": ("spine4", (0.0, 0.01, 0.04)),
    "rShoulder": ("spine4", (0.0, -0.01, 0.04)),
    "lHip": ("lThigh", (0.03, -0.01, -0.02)),
    "rHip": ("rThigh", (0.03, 0.01, -0.02)),
    "Nose": ("head", (0.01, 0.0, 0.01)),
}


def made_people(count, noise=0.0, seed=0):
    """Two people in turn whose segments are turned at random."""
    rng = np.random.default_rng(seed)
    segments = len(MODEL.names)
    frames = Rotation.random(count * segments, random_state=seed).as_matrix().reshape(count, segments, 3, 3)
    truth = rng.normal(size=(count, len(NAMES), 3))
    seen = truth + rng.normal(0.0, noise, truth.shape) if noise else truth.copy()
    for j, name in enumerate(NAMES):
        segment, offset = OFFSETS[name]
        seen[:, j] += frames[:, MODEL.index(segment)] @ np.array(offset)
    return MatchedSkeletons(np.arange(count) % 2, truth, seen, frames)


def test_offsets_are_found_in_the_segment_that_carries_them():
    people = made_people(40, 0.005)
    found = measure_joint_offsets(people, NAMES, MODEL)
    for name, (segment, offset) in OFFSETS.items():
        assert found[name].frame == segment
        assert np.allclose(found[name].offset, offset, atol=0.003)
    assert MODEL.with_joint_offsets(found).offsets == found


def test_outliers_and_missing_joints_change_nothing():
    people = made_people(41)
    people.seen[::5, 0] += 0.5
    people.seen[1::5, 0] = np.nan
    found = measure_joint_offsets(people, NAMES, MODEL)
    assert np.allclose(found["lShoulder"].offset, OFFSETS["lShoulder"][1], atol=1e-9)
    people.seen[: 41 - FEWEST // 2 + 1, 4] = np.nan
    assert "Nose" not in measure_joint_offsets(people, NAMES, MODEL)


def test_they_are_taken_out_and_judged_on_others():
    people = made_people(40)
    found = measure_joint_offsets(people, NAMES, MODEL)
    assert np.allclose(corrected_joints(people, NAMES, MODEL, found), people.truth)
    benefits = judge_joint_offsets(people, NAMES, MODEL)
    assert [b.person for b in benefits] == [0, 1]
    assert all(b.median_before > 10.0 and b.median_after < 1e-6 for b in benefits)
    assert judge_joint_offsets(people.rows(people.ids == 0), NAMES, MODEL) == ()
