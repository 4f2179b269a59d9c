"""PCP by both rules on a stick figure with known answers."""

from __future__ import annotations

import numpy as np
import pytest

from panoptic_ros.errors import DataError
from panoptic_ros.evaluation import SkeletonFrame, SkeletonSequence, evaluate_pcp, pcp_table
from panoptic_ros.evaluation.annotations import is_annotation, parse_annotation
from panoptic_ros.evaluation.pcp import (
    ANNOTATION_JOINTS,
    NamedJoints,
    head_of_association,
    head_of_voxelpose,
    plain_name,
)

STICK = {  # faces +x, m
    "lAnkle": (0.0, 0.1, 0.1),
    "rAnkle": (0.0, -0.1, 0.1),
    "lKnee": (0.0, 0.1, 0.5),
    "rKnee": (0.0, -0.1, 0.5),
    "lHip": (0.0, 0.1, 0.9),
    "rHip": (0.0, -0.1, 0.9),
    "lWrist": (0.0, 0.3, 0.9),
    "rWrist": (0.0, -0.3, 0.9),
    "lElbow": (0.0, 0.25, 1.15),
    "rElbow": (0.0, -0.25, 1.15),
    "lShoulder": (0.0, 0.2, 1.4),
    "rShoulder": (0.0, -0.2, 1.4),
    "Nose": (0.1, 0.0, 1.6),
    "lEar": (0.0, 0.08, 1.62),
    "rEar": (0.0, -0.08, 1.62),
}
NAMES = tuple(STICK)
POSE = np.array(list(STICK.values()))
RULES = ("pcp-voxelpose", "pcp-4d-association")


def annotation(rule: str) -> np.ndarray:
    """The 14 joints that the rule makes of the stick figure."""
    joints = NamedJoints(NAMES, POSE[None])
    head = {"pcp-voxelpose": head_of_voxelpose, "pcp-4d-association": head_of_association}[rule](joints)
    return np.concatenate([[joints[name][0] for name in ANNOTATION_JOINTS[:12]], head[0]])


def sequences(rule, actors, people):
    truth = np.stack([annotation(rule) + [x, 0.0, 0.0] for x in actors])
    result = np.array([POSE + [x, 0.0, 0.0] for x in people]).reshape(-1, len(NAMES), 3)
    return (
        SkeletonSequence(ANNOTATION_JOINTS, (SkeletonFrame(0, range(len(actors)), truth),)),
        SkeletonSequence(NAMES, (SkeletonFrame(0, range(len(people)), result),)),
    )


@pytest.mark.parametrize("rule", RULES)
def test_the_true_pose_is_right_in_all_limbs(rule):
    report = evaluate_pcp(*sequences(rule, [0.0, 2.0], [2.0, 0.0]), rule)
    assert report.mean == 1.0 and report.by_actor == (1.0, 1.0) and report.actors == (1, 2)
    assert "100.00" in pcp_table(report)


@pytest.mark.parametrize("rule", RULES)
def test_a_limb_is_right_up_to_half_of_its_length(rule):
    truth, result = sequences(rule, [0.0], [0.0])
    moved = result.frames[0].positions.copy()
    moved[0, NAMES.index("lAnkle"), 0] += 0.39  # both ends: (0.39 + 0) / 2 <= 0.4 / 2
    near = SkeletonSequence(NAMES, (SkeletonFrame(0, [0], moved),))
    assert evaluate_pcp(truth, near, rule).mean == 1.0
    moved[0, NAMES.index("lAnkle"), 0] += 0.02
    far = SkeletonSequence(NAMES, (SkeletonFrame(0, [0], moved),))
    report = evaluate_pcp(truth, far, rule)
    assert report.mean == pytest.approx(0.9)
    assert dict(zip(report.limbs, report.limb_means))["left lower leg"] == 0.0


def test_missed_people_are_wrong_in_one_rule_and_left_out_in_the_other():
    lone = [evaluate_pcp(*sequences(rule, [0.0, 2.0], [0.0]), rule) for rule in RULES]
    assert lone[0].by_actor == (1.0, 0.0) and lone[0].mean == 0.5
    assert lone[1].poses == (1, 0) and lone[1].mean == 1.0
    nobody = [evaluate_pcp(*sequences(rule, [0.0], []), rule) for rule in RULES]
    assert nobody[0].mean == 0.0 and np.isnan(nobody[1].mean)


def test_ghosts_cost_nothing_and_the_fourth_actor_is_not_averaged():
    rule = RULES[0]
    report = evaluate_pcp(*sequences(rule, [0.0, 2.0, 4.0, 6.0], [0.0, 2.0, 4.0, 20.0]), rule)
    assert report.mean == 1.0 and report.by_actor[3] == 0.0


def test_a_missing_joint_makes_its_limbs_wrong():
    rule = RULES[0]
    truth, result = sequences(rule, [0.0], [0.0])
    holes = result.frames[0].positions.copy()
    holes[0, NAMES.index("rElbow")] = np.nan
    report = evaluate_pcp(truth, SkeletonSequence(NAMES, (SkeletonFrame(0, [0], holes),)), rule)
    assert report.mean == pytest.approx(0.8)


def test_one_ear_stands_for_both():
    pose = POSE.copy()
    pose[NAMES.index("lEar")] = np.nan
    assert NamedJoints(NAMES, pose[None]).middle("ear")[0] == pytest.approx(STICK["rEar"])


def test_names_of_joints():
    assert plain_name("lShoulder") == plain_name("LShoulder") == plain_name("left_shoulder")
    assert plain_name("BodyCenter") == plain_name("MidHip") == "mid_hip"


def test_joints_that_are_needed_are_named():
    rule = RULES[0]
    truth, _ = sequences(rule, [0.0], [0.0])
    with pytest.raises(DataError, match="left_shoulder"):
        evaluate_pcp(truth, SkeletonSequence(("nose",), (SkeletonFrame(0, [0], np.zeros((1, 1, 3))),)), rule)
    with pytest.raises(DataError, match="annotation"):
        evaluate_pcp(SkeletonSequence(("nose",), ()), truth, rule)


def test_annotation_documents():
    people = [{"id": 2, "joints": [[0, 0, 1]]}]
    document = {"unit": "m", "joint_names": ["nose"], "frames": {"10": [], "9": people}}
    assert is_annotation(document) and not is_annotation({"frames": []})
    sequence = parse_annotation(document, "truth.json")
    assert [frame.stamp_ns for frame in sequence.frames] == [360_000_000, 400_000_000]
    assert sequence.frames[0].ids.tolist() == [2]
    for broken in ({**document, "unit": "mm"}, {**document, "frames": {"x": people}}):
        with pytest.raises(DataError, match=r"truth\.json"):
            parse_annotation(broken, "truth.json")
