"""The report: numbers that are known, text that fits, JSON that any program reads."""

import json
import math

import numpy as np
import pytest

from panoptic_ros.domain import DetectionSet, JointState, SkeletonModel
from panoptic_ros.evaluation.capture_report import (
    bone_lengths,
    limb_joints,
    reprojection_errors,
    summarise_capture,
    typical_acceleration,
)
from panoptic_ros.stage import Notice
from panoptic_ros.view.report import Latency, RunReport


def _set(pose, views):
    return DetectionSet(pose.index, pose.stamp_ns, pose.skeleton_hash, views)


@pytest.fixture
def skeleton():
    """As the common one, with names on both sides so that there are limb joints."""
    names = ("hip", "head", "left_knee", "left_ankle")
    return SkeletonModel("stick", names, 0, ((0, 1), (0, 2), (2, 3)), 1, ((2, 3),))


def test_reprojection_errors_are_those_put_in_whatever_the_order_of_people(rig, skeleton, make_poses, detect):
    poses, sets = [], []
    for i in range(5):
        pose = make_poses([(0.5, 0.1 * i), (-0.5, -0.1 * i)], [4, 9], i)
        order = (1, 0) if i % 2 else (0, 1)
        shifts = [(3.0, 4.0), (0.0, 0.0), (6.0, 8.0), (0.0, 1.0)]
        views = [detect(c, pose, shift, order) for c, shift in zip(rig.cameras, shifts)]
        poses.append(pose)
        sets.append(_set(pose, views))
    errors = reprojection_errors(rig, skeleton, poses, sets)
    assert len(errors.px) == 5 * 4 * 2 * 4
    assert np.allclose(errors.px, np.array([5.0, 0.0, 10.0, 1.0])[errors.cameras], atol=1e-9)
    summary = summarise_capture(rig, skeleton, poses, sets)
    medians = [spread.median for spread in summary.reprojection_by_camera.values()]
    assert medians == pytest.approx([5, 0, 10, 1], abs=1e-9)
    assert summary.reprojection_px.median == pytest.approx(3.0) and summary.reprojection_px.count == 160
    assert [p.identity for p in summary.people] == [4, 9]


def test_only_measured_joints_of_matched_people_count(rig, skeleton, make_poses, detect):
    states = [[JointState.MEASURED] * 3 + [JointState.PREDICTED], [JointState.MEASURED] * 4]
    pose = make_poses([(0.0, 0.0), (1.2, 0.0)], [1, 2], states=states)
    alone = make_poses([(0.0, 0.0)], [1])
    errors = reprojection_errors(rig, skeleton, [pose], [_set(pose, [detect(rig.cameras[1], alone)])])
    assert errors.ids.tolist() == [1, 1, 1] and errors.joints.tolist() == [0, 1, 2]
    far = _set(pose, [detect(rig.cameras[1], alone, shift=(0.0, 90.0))])
    assert len(reprojection_errors(rig, skeleton, [pose], [far]).px) == 0
    assert len(reprojection_errors(rig, skeleton, [pose], []).px) == 0


def test_joints_and_bones_are_counted(rig, skeleton, make_poses):
    missing = [[JointState.MEASURED] * 2 + [JointState.FILLED, JointState.MISSING]]
    poses = [make_poses([(0, 0)], [1], i, states=missing if i == 3 else None) for i in range(4)]
    stretched = poses[1].positions.copy()
    stretched[0, 3, 2] -= 0.04  # the shank is 4 cm longer once
    poses[1] = make_poses([(0, 0)], [1], 1)
    object.__setattr__(poses[1], "positions", stretched)
    lengths = bone_lengths(skeleton, poses, 1)
    assert lengths.shape == (4, 3) and np.isnan(lengths[3]).tolist() == [False, False, True]
    person = summarise_capture(rig, skeleton, poses, []).people[0]
    assert (person.frames, person.joints_found, person.measured) == (4, 15 / 16, 14 / 15)
    assert person.limb_joints_found == 7 / 8
    assert person.limbs == ("left_knee-left_ankle",)
    assert person.bone_std_cm["left_knee-left_ankle"] == pytest.approx(100 * np.std([0.45, 0.49, 0.45]))
    assert person.bone_length_cm["hip-head"] == pytest.approx(70.0)
    assert math.isnan(person.reprojection_px.median)


def test_accelerations_are_those_of_the_motion_whatever_the_steps():
    times = np.cumsum([0.0, 0.03, 0.05, 0.04, 0.03, 0.5, 0.04])
    positions = 0.5 * 3.0 * times[:, None, None] ** 2 * [0.0, 0.6, 0.8] + np.zeros((7, 2, 3))
    positions[5, 1] = np.nan
    stamps = np.round(1e9 * times).astype(np.int64)
    assert typical_acceleration(stamps, positions) == pytest.approx(3.0)
    positions[5:] += 9.0  # somebody who was away is somewhere else
    assert typical_acceleration(stamps, positions) == pytest.approx(3.0)
    assert math.isnan(typical_acceleration(stamps[:2], positions[:2]))


def test_limb_joints_of_the_default_skeleton():
    names = ("BodyCenter", "lHip", "rHip", "lKnee", "rKnee", "Nose")
    model = SkeletonModel("part", names, 0, ((0, 1), (0, 2), (1, 3), (2, 4), (0, 5)), 5, ((1, 2), (3, 4)))
    assert limb_joints(model) == (1, 2, 3, 4)


def _report(rig, skeleton, make_poses, detect, **more):
    poses = [make_poses([(0.4, 0.0), (-0.4, 0.0)], [2, 11], i) for i in range(3)]
    sets = [_set(p, [detect(c, p, (3.0, 4.0)) for c in rig.cameras]) for p in poses]
    return RunReport(summarise_capture(rig, skeleton, poses, sets), **more)


def test_table_and_document_say_the_same(rig, skeleton, make_poses, detect, tmp_path):
    notices = [Notice("sync.late_frame", "warning", "a frame came late"), Notice("x.y", "info", "other")] * 2
    report = _report(
        rig,
        skeleton,
        make_poses,
        detect,
        frames_in={"cam0": 3, "cam1": 3},
        dropped={"queue full": 2, "late": 0},
        latency_ms={"detection": Latency(101, 50.0, 99.0), "sync": Latency(0, np.nan, np.nan)},
        notices=notices,
        facts={"model": "movenet"},
    )
    table = report.table()
    for text in (
        "id 2",
        "id 11",
        "movenet",
        "6 images of 2 cameras",
        "2 queue full",
        "100.0 %",
        "a frame came late (2 times)",
        "detection",
        "50.0",
        "99.0",
        "5.0",
    ):
        assert text in table
    assert "late\n" not in table and "nan" not in table
    report.write(tmp_path / "report.json")
    document = json.loads((tmp_path / "report.json").read_text())
    assert document["format"] == "panoptic-report-1" and document["model"] == "movenet"
    assert [person["id"] for person in document["people"]] == [2, 11]
    assert document["reprojection_px"]["cameras"]["cam2"]["median"] == pytest.approx(5.0)
    assert document["latency_ms"]["sync"] == {"count": 0, "p50": None, "p99": None}
    assert document["frames"] == {
        "in": {"cam0": 3, "cam1": 3},
        "out": 3,
        "with_people": 3,
        "dropped": {"queue full": 2, "late": 0},
    }
    assert document["notices"][0]["count"] == 2


def test_a_run_without_people_is_reported_too(rig, skeleton, make_poses):
    report = RunReport(summarise_capture(rig, skeleton, [make_poses([], [], i) for i in range(2)], []))
    assert "no people were found" in report.table() and "2, of which 0" in report.table()
    assert json.dumps(report.document(), allow_nan=False)
    empty = RunReport(summarise_capture(rig, skeleton, [], []))
    assert "frames out      0" in empty.table()


def test_many_people_do_not_flood_the_table(rig, skeleton, make_poses):
    pose = make_poses([(0.1 * i, 0.0) for i in range(20)], list(range(20)))
    table = RunReport(summarise_capture(rig, skeleton, [pose], [])).table()
    assert "... and 8 more" in table and table.count("id ") == 12
