"""Captures in folders: with 2D people, and with images in which people are detected first."""

from types import SimpleNamespace

import numpy as np
import pytest

from panoptic_ros.io.body_files import write_bodies
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.files import write_json
from panoptic_ros.io.kinematic_files import read_subject, subject_document, write_imus
from panoptic_ros.io.recorded_motions import read_clips
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.simulation import SKELETON
from panoptic_ros.simulation.bodies.capture import BodyScene, simulate_body
from panoptic_ros.simulation.bodies.group import group_of
from panoptic_ros.study.bodies import cases

MODEL = read_body_model()


@pytest.fixture
def folder(tmp_path):
    take = simulate_body(BodyScene(("02_05",), seconds=0.3, cameras=2), 1, MODEL, read_clips())
    write_rig(tmp_path / "rig.json", take.rig)
    write_json(tmp_path / "subject.json", subject_document(take.subject))
    write_bodies(tmp_path / "truth.json.gz", MODEL, take.truth())
    return tmp_path, take


@pytest.mark.parametrize("imus", [False, True])
def test_people_are_detected_where_a_capture_has_images(folder, monkeypatch, imus):
    path, take = folder
    group = group_of(take)
    sets = [SimpleNamespace(views=group.detections(t, SKELETON)) for t in range(len(take.stamps))]
    if imus:
        write_imus(path / "imu.csv.gz", take.devices)
    found = SimpleNamespace(
        context=SimpleNamespace(rig=take.rig, skeleton=SKELETON),
        sets=sets,
        subjects=(read_subject(path / "subject.json", MODEL),),
    )
    monkeypatch.setattr(cases, "detected", lambda *_: found)
    case = cases.read_case(path)
    assert len(case.recording.devices) == (13 if imus else 0) and len(case.truth) == len(take.stamps)
    wanted, columns = cases.recording_of(take), [take.joint_names.index(n) for n in SKELETON.joint_names]
    for camera, series in wanted.views.items():
        mine = case.recording.views[camera]
        np.testing.assert_array_equal(mine.stamps, series.stamps)
        for one, other in zip(mine.people, series.people):
            seen = other.scores[0, columns] > 0.0
            np.testing.assert_allclose(one.points[0][seen], other.points[0][columns][seen])
            np.testing.assert_array_equal(one.scores[0], other.scores[0, columns])
