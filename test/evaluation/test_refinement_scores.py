"""Figures of smoothing against errors that are known exactly."""

import captures
import numpy as np
import patch_scene
import pytest

from panoptic_ros.errors import DataError
from panoptic_ros.evaluation import SkeletonFrame, SkeletonSequence, pair_sequences
from panoptic_ros.evaluation.filtering import savitzky_golay
from panoptic_ros.evaluation.refinement_scores import refinement_scores
from panoptic_ros.geometry.torso import torso_frames

NAMES = captures.SKELETON.joint_names
CORNERS = [NAMES.index(name) for name in ("lShoulder", "rShoulder", "lHip", "rHip")]
STEP = 40_000_000


def sequence(frames):
    return SkeletonSequence(
        NAMES, tuple(SkeletonFrame(k * STEP, np.array([3]), points[None]) for k, points in enumerate(frames))
    )


def walked(speed, count=12):
    """Somebody who turns slowly and goes at a speed, (count, 19, 3) m."""
    return np.array([captures.person((0.04 * speed * k, 0.0), 0.1 * k) for k in range(count)])


def scores(truth, result):
    return refinement_scores(pair_sequences(sequence(truth), sequence(result)), NAMES)


def test_an_offset_that_turns_with_the_torso_is_no_error_but_of_the_mean():
    truth = walked(0.3)
    axes, _ = torso_frames(truth[:, CORNERS])
    result = truth + (axes @ np.array([0.03, 0.0, 0.04]))[:, None]
    found = scores(truth, result)
    assert found["mpjpe_mm"] == pytest.approx(50.0, abs=1e-6)
    assert found["offset_free_mm"] == pytest.approx(0.0, abs=1e-6)
    assert found["pck_10cm"] == 1.0 and np.isnan(found["fast_mm"])


def test_an_error_that_alternates_stays_and_shows_as_acceleration():
    truth = walked(0.0)
    signs = (-1.0) ** np.arange(len(truth))
    result = truth + 0.01 * signs[:, None, None] * np.array([0.0, 0.0, 1.0])
    found = scores(truth, result)
    assert found["offset_free_mm"] == pytest.approx(10.0, rel=1e-6)
    assert found["acceleration_error"] == pytest.approx(4 * 0.01 / 0.04**2, rel=1e-6)


def test_fast_joints_are_told_by_the_truth():
    truth = walked(2.0)
    noise = np.zeros_like(truth)
    noise[::2, 0] = 0.02
    found = scores(truth, truth + noise)
    assert found["fast_mm"] > 0.0
    assert np.isnan(scores(walked(0.2) * [1, 1, 0.2], walked(0.2) * [1, 1, 0.2])["fast_mm"])


def test_a_joint_that_is_missing_lowers_the_share_within_reach():
    truth = walked(0.0)
    result = truth.copy()
    result[:, 5] = np.nan
    assert scores(truth, result)["pck_10cm"] == pytest.approx(18 / 19)


def test_a_truth_without_a_torso_is_refused():
    with pytest.raises(DataError, match="lShoulder"):
        refinement_scores([], ("nose",))


def test_savitzky_and_golay_leave_a_parabola_and_gaps_as_they_are():
    places = [captures.person((0.01 * k * k, 0.02 * k), 0.4) for k in range(12)]
    wrist = NAMES.index("lWrist")
    gaps = [[wrist] if k == 5 else [] for k in range(12)]
    raw = [patch_scene.skeletons(k, points, missing=gaps[k]) for k, points in enumerate(places)]
    for k, frame in enumerate(savitzky_golay(raw)):
        assert np.isnan(frame.positions[0, wrist]).all() == (k == 5)
        rest = [joint for joint in range(len(NAMES)) if joint != wrist]
        assert frame.positions[0, rest] == pytest.approx(places[k][rest], abs=1e-9)
