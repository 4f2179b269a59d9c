"""Subject files of a run."""

import json

import captures
import numpy as np
import pytest
from recordings import write_bag

from panoptic_ros.cli.main import main
from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.graph.build import configure
from panoptic_ros.io.files import read_json
from panoptic_ros.running.plans.designated import subject_files, with_subjects
from panoptic_ros.running.plans.plan import Plan


def subject(path, number, start=None):
    place = {} if start is None else {"start": start}
    path.write_text(json.dumps({"format": "panoptic-subject-1", "id": number, "height_m": 1.7, **place}))
    return path


def plan(**tracking):
    return Plan("", captures.RIG, captures.SKELETON, configure({"tracking": tracking}))


def test_files_become_words_of_tracking(tmp_path):
    paths = (subject(tmp_path / "subject_b.json", 4, [0.5, -1.25, 0.9]), subject(tmp_path / "a.json", 0))
    found = with_subjects(plan(), paths)
    assert found.configs["tracking"].subjects == ("4=0.5 -1.25 0.9", "0") and found.subjects == paths
    assert found.configs["continuous"].subjects == found.configs["tracking"].subjects
    assert subject_files(tmp_path, [paths[1]]) == (paths[1], paths[0])
    assert subject_files(tmp_path, [paths[0]]) == (paths[0],)  # once


def test_what_cannot_be_is_refused(tmp_path):
    a, b = subject(tmp_path / "a.json", 4), subject(tmp_path / "b.json", 4)
    with pytest.raises(UsageError, match=r"a.json and .*b.json both have id 4; change one"):
        with_subjects(plan(), (a, b))
    with pytest.raises(DataError, match=r"c.json: id = -1; ids of subjects are whole numbers"):
        with_subjects(plan(), (subject(tmp_path / "c.json", -1),))
    with pytest.raises(UsageError, match="--subject and tracking.subjects both"):
        with_subjects(plan(subjects=["1"]), (a,))
    own = Plan("", captures.RIG, captures.SKELETON, configure({"continuous": {"subjects": ["1"]}}))
    with pytest.raises(UsageError, match="--subject and continuous.subjects both"):
        with_subjects(own, (a,))
    a.write_text("{}")
    with pytest.raises(DataError, match=r"a.json is not a panoptic-subject-1 file"):
        with_subjects(plan(), (a,))


def test_a_run_reports_the_designated_alone(tmp_path):
    bag = write_bag(tmp_path / "bag", captures.views(), captures.RIG, captures.SKELETON)
    first = min(view.stamp_ns for view in captures.views())
    middle = captures.people(1e-9 * first)[1].mean(axis=0)
    given = subject(tmp_path / "anna.json", 17, np.round(middle, 3).tolist())
    out = tmp_path / "out"
    arguments = ["run", "--bag", str(bag), "--out", str(out), "--in-process", "--no-pictures"]
    assert main([*arguments, "--subject", str(given)]) == 0
    frames = read_json(out / "skeletons.json.gz")["frames"]
    assert frames
    for frame in frames:
        (found,) = frame["skeletons"]
        truth = captures.people(1e-9 * frame["stamp_ns"])[1]
        assert found["id"] == 17 and np.allclose(found["joints"], truth, atol=0.01)
