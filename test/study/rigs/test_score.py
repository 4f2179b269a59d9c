"""Table 3's definitions and the PCK curve, on frames whose errors are known."""

import numpy as np
import pytest

from panoptic_ros.evaluation import SkeletonFrame, SkeletonSequence, pair_sequences
from panoptic_ros.study.rigs.score import THRESHOLDS, score_study

NAMES = ("a", "b", "c", "d")
BODY = np.array([[0.0, 0, 0], [0, 0, 0.5], [0, 0, 1.0], [0, 0.3, 1.0]])


def sequence(*people_of_frames):
    frames = [
        SkeletonFrame(1_000_000_000 + 40_000_000 * i, range(len(people)), np.reshape(people, (-1, 4, 3)))
        for i, people in enumerate(people_of_frames)
    ]
    return SkeletonSequence(NAMES, tuple(frames))


def test_outliers_missed_nodes_and_missed_people_all_count():
    near, far = BODY + [0.03, 0, 0], BODY.copy()
    far[1] += [0.0, 0.08, 0.0]
    holes = BODY.copy()
    holes[3] = np.nan
    other = BODY + [3.0, 0.0, 0.0]
    truth = sequence([BODY, other], [BODY], [BODY])
    result = sequence([near], [far], [holes, BODY + [9.0, 0.0, 0.0]])
    score = score_study(pair_sequences(truth, result), range(4))
    assert (score.skeletons, score.nodes) == (4, 16)
    assert (score.outlier_nodes, score.missed_nodes, score.ghosts) == (1, 5, 1)
    assert score.node_accuracy == pytest.approx(10 / 16) and score.skeleton_accuracy == pytest.approx(1 / 4)
    assert np.interp([0.02, 0.05, 0.09], THRESHOLDS, score.pck) == pytest.approx([6 / 16, 10 / 16, 11 / 16])
    assert (np.diff(score.pck) >= 0.0).all()


def test_only_some_joints_may_count():
    far = BODY.copy()
    far[1] += [0.0, 0.08, 0.0]
    pairs = pair_sequences(sequence([BODY]), sequence([far]))
    assert score_study(pairs, [0, 2, 3]).skeleton_accuracy == 1.0
    assert score_study(pairs, range(4), outlier_m=0.1).skeleton_accuracy == 1.0
    assert score_study(pairs, range(4)).skeleton_accuracy == 0.0


def test_nobody_at_all_is_not_defined():
    score = score_study([], range(4))
    assert score.nodes == 0 and np.isnan(score.node_accuracy) and np.isnan(score.median_mm)
