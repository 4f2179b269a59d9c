"""Scores of hand-made cases with known answers."""

from __future__ import annotations

import numpy as np
import pytest

from panoptic_ros.errors import DataError
from panoptic_ros.evaluation import SkeletonSequence, evaluate, report_table


def test_truth_against_itself_is_perfect(build):
    truth = build.walk()
    scores = evaluate(truth, truth).to_mapping()
    assert scores["mpjpe_mm"] == 0.0 and scores["median_mm"] == 0.0
    for name in ("joint_recall", "joint_precision", "person_recall", "person_precision", "mota", "idf1"):
        assert scores[name] == 1.0, name
    assert scores["id_switches"] == scores["fragments"] == 0
    assert scores["acceleration_error"] == pytest.approx(0.0, abs=1e-9)
    assert scores["nees"] is None
    assert set(scores["pck"].values()) == {1.0}


def test_a_shift_is_measured_in_every_joint(build):
    report = evaluate(build.walk(), build.walk(offset=(0.03, 0.0, 0.04)))
    assert report.joints.mpjpe_mm == pytest.approx(50.0)
    assert report.joints.median_mm == pytest.approx(50.0)
    assert [joint.mean_mm for joint in report.joints.by_joint] == pytest.approx([50.0] * 4)
    assert dict(report.joints.pck)[0.02] == 0.0 and dict(report.joints.pck)[0.10] == 1.0
    assert report.joints.recall == 1.0


def test_missing_joints_cost_recall_and_pck_but_not_mpjpe(build):
    joints = build.people_at(0, 1)
    hole = joints.copy()
    hole[0, 3] = np.nan
    report = evaluate(build.single(joints), build.single(hole))
    assert report.joints.mpjpe_mm == 0.0
    assert report.joints.recall == pytest.approx(3 / 4) and report.joints.precision == 1.0
    assert dict(report.joints.pck)[0.15] == pytest.approx(3 / 4)
    assert np.isnan(report.joints.by_joint[3].mean_mm) and report.joints.by_joint[3].recall == 0.0


def test_a_far_joint_costs_precision(build):
    joints = build.people_at(0, 1)
    wrong = joints.copy()
    wrong[0, 1, 2] += 0.2
    report = evaluate(build.single(joints), build.single(wrong))
    assert report.people.found == 1, "mean distance 5 cm"
    assert report.joints.precision == pytest.approx(3 / 4)
    assert report.joints.mpjpe_mm == pytest.approx(50.0)


def test_a_match_above_the_found_threshold_is_no_person_found(build):
    report = evaluate(build.walk(5), build.walk(5, offset=(0.0, 0.0, 0.2)))
    assert report.people.found == 0 and report.people.recall == 0.0
    assert report.joints.mpjpe_mm == pytest.approx(200.0), "it is still a match"
    assert report.identities.mota == pytest.approx(1.0 - 20 / 10)


def test_a_result_beyond_the_gate_is_no_match(build):
    report = evaluate(build.walk(5), build.walk(5, offset=(0.0, 0.6, 0.0)))
    assert np.isnan(report.joints.mpjpe_mm) and report.joints.recall == 0.0


def test_matching_is_optimal_and_not_greedy(build):
    truth = build.frame(0, [0, 1], [build.people_at(0, 1)[0], build.people_at(0, 1)[0] + [0.0, 0.3, 0.0]])
    # the first result is nearest to person 1, but only it can serve person 0
    result = build.frame(0, [7, 8], truth.positions + np.array([[[0.0, 0.16, 0.0]], [[0.0, 0.2, 0.0]]]))
    report = evaluate(build.sequence([truth]), build.sequence([result]))
    assert report.joints.mpjpe_mm == pytest.approx(180.0)


def test_an_exchange_of_identities(build):
    swapped = build.walk(10, ids=lambda index: [0, 1] if index < 5 else [1, 0])
    report = evaluate(build.walk(10), swapped)
    assert report.identities.switches == 2 and report.identities.fragments == 0
    assert report.identities.idf1 == pytest.approx(0.5)
    assert report.identities.mota == pytest.approx(1.0 - 2 / 20)


def test_a_gap_is_a_fragment_and_a_ghost_a_false_person(build):
    truth = build.walk(6)
    frames = list(truth.frames)
    frames[2] = build.frame(2, [1], build.people_at(2)[1:])
    ghost = np.concatenate([build.people_at(4), build.people_at(4, 1) + [5.0, 5.0, 0.0]])
    frames[4] = build.frame(4, [0, 1, 77], ghost)
    report = evaluate(truth, build.sequence(frames))
    assert report.people.recall == pytest.approx(11 / 12)
    assert report.people.precision == pytest.approx(11 / 12)
    assert report.identities.fragments == 1 and report.identities.switches == 0
    assert report.identities.mota == pytest.approx(1.0 - 2 / 12)
    assert report.identities.idf1 == pytest.approx(22 / 24)


def test_ignored_people_count_neither_way(build):
    ignored = np.array([False, True])
    truth = build.walk(6, ignored=ignored)
    for result in (build.walk(6), build.walk(6, count=1)):
        report = evaluate(truth, result)
        assert report.people.truth == report.people.result == report.people.found == 6
    near = build.sequence(
        build.frame(i, [0, 1, 2], np.concatenate([build.people_at(i), build.people_at(i)[1:] + 0.2]))
        for i in range(6)
    )
    assert evaluate(truth, near).people.precision == 1.0, "a second result close to an ignored person"


def test_a_frame_without_a_result_counts_as_missed(build):
    truth = build.walk(6)
    report = evaluate(truth, build.sequence(truth.frames[:3]))
    assert report.frames == 6 and report.paired_frames == 3
    assert report.people.recall == 0.5 and report.people.precision == 1.0
    assert evaluate(truth, build.sequence([])).people.recall == 0.0


def test_skip_leaves_out_the_first_frames(build):
    truth = build.walk(6)
    report = evaluate(truth, build.sequence(truth.frames[2:]), skip=2)
    assert report.frames == 4 and report.people.recall == 1.0


def test_a_result_is_judged_at_its_own_stamp(build):
    late = build.sequence(
        build.frame(i, [0, 1], build.people_at(i) + [0.01, 0.0, 0.0], delay_ns=10_000_000) for i in range(10)
    )
    report = evaluate(build.walk(10), late)
    assert report.joints.mpjpe_mm == pytest.approx(0.0, abs=1e-9)
    assert report.mean_offset_ms == pytest.approx(10.0)


def test_two_results_for_one_truth_frame_use_the_nearer_one(build):
    truth = build.walk(5)
    double = [build.frame(i, [0, 1], build.people_at(i) + 1.0, delay_ns=9_000_000) for i in range(5)]
    report = evaluate(truth, build.sequence([*double, *truth.frames]))
    assert report.joints.mpjpe_mm == 0.0 and report.people.result == 10


def test_known_covariances_give_known_consistency(build):
    covariance = np.broadcast_to(0.01**2 * np.eye(3), (2, 4, 3, 3))
    result = build.walk(10, offset=(0.03, 0.0, 0.0), covariances=covariance)
    nees = evaluate(build.walk(10), result).consistency
    assert nees is not None and nees.joints == 80
    assert nees.mean_per_dof == pytest.approx(3.0) and nees.cover95 == 0.0


def test_consistency_is_told_by_number_of_views(build):
    covariance = np.broadcast_to(0.01**2 * np.eye(3), (2, 4, 3, 3))
    views = np.array([[0, 1, 2, 3], [3, 5, 9, -1]])
    offset = np.where(views < 3, 0.03, 0.02)[..., None] * [1.0, 0.0, 0.0]
    result = build.sequence(
        build.frame(i, [0, 1], build.people_at(i) + offset, covariances=covariance, views=views)
        for i in range(10)
    )
    nees = evaluate(build.walk(10), result).consistency
    assert nees is not None
    told = {some.kind: (round(some.mean_per_dof, 6), some.joints) for some in nees.by_views}
    assert told == {
        "predicted, filled": (3.0, 10),
        "1 or 2 views": (3.0, 20),
        "3 views": (round(4 / 3, 6), 20),
        "5 views and more": (round(4 / 3, 6), 20),
    }


def test_acceleration_error_of_a_zigzag(build):
    zigzag = build.sequence(
        build.frame(i, [0, 1], build.people_at(i) + [0.0, 0.0, 0.01 * (i % 2)]) for i in range(10)
    )
    report = evaluate(build.walk(10), zigzag)
    assert report.acceleration_error == pytest.approx(2 * 0.01 / 0.04**2)


def test_joints_are_matched_by_name(build):
    truth = build.walk(4)
    order = [2, 0, 1]
    other = SkeletonSequence(
        ("BodyCenter", "Neck", "Nose"),
        tuple(type(f)(f.stamp_ns, f.ids, f.positions[:, order]) for f in truth.frames),
    )
    report = evaluate(truth, other)
    assert report.joints.mpjpe_mm == 0.0 and report.joints.recall == pytest.approx(3 / 4)


def test_bad_input_is_named(build):
    with pytest.raises(DataError, match="no frames"):
        evaluate(build.sequence([]), build.walk())
    with pytest.raises(DataError, match="none of the truth's joints"):
        evaluate(build.walk(), SkeletonSequence(("tail",), ()))
    with pytest.raises(DataError, match="twice"):
        build.frame(0, [3, 3], build.people_at(0))


def test_the_table_shows_what_was_measured(build):
    text = report_table(evaluate(build.walk(), build.walk(offset=(0.03, 0.0, 0.04))))
    assert "50.0 mm mean" in text and "lWrist" in text and "no covariances" in text
    empty = report_table(evaluate(build.walk(), build.sequence([])))
    assert "- mm mean" in empty


def test_people_whom_nothing_matches_cost_pck_of_everybody(build):
    joints = build.people_at(0, 2)
    ghost = build.people_at(0, 1) + [9.0, 9.0, 0.0]
    report = evaluate(build.single(joints), build.single(np.concatenate([joints[:1], ghost])))
    assert dict(report.joints.pck)[0.02] == 1.0
    assert dict(report.joints.pck_of_everybody)[0.02] == report.joints.recall == 0.5
    assert report.people.unmatched_per_frame == 1.0


def test_switches_over_gaps_of_the_truth_are_told_apart(build):
    def blocks(name):
        return build.sequence(build.frame(i, name(i), build.people_at(i, 1)) for i in (0, 1, 2, 40, 41, 42))

    swapped = evaluate(blocks(lambda i: [0]), blocks(lambda i: [i // 40 + (i > 41)])).identities
    assert (swapped.switches, swapped.switches_over_gaps) == (2, 1)
    table = report_table(evaluate(blocks(lambda i: [0]), blocks(lambda i: [i // 40])))
    assert "1 (1 over gaps of the truth), fragments 0" in table


def test_people_with_the_id_of_the_truth_are_counted(build):
    truth = build.walk(ids=lambda _: [3, 5])
    for ids, share in (([3, 5], 1.0), ([3, 0], 0.5), ([5, 3], 0.0)):
        result = build.walk(ids=lambda _, ids=ids: ids)
        assert evaluate(truth, result).identities.same_ids == share
