"""Runs from Python: a plan of plain values, an outcome, an observer that is told."""

import json

import captures
import numpy as np
import pytest
from recordings import write_bag

from panoptic_ros.cli.main import main
from panoptic_ros.domain import ViewFrame
from panoptic_ros.errors import UsageError
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.bags import BagReader
from panoptic_ros.io.messages import from_message
from panoptic_ros.io.plain_formats import read_skeletons
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.running.evaluate import evaluate
from panoptic_ros.running.plans.bag_plan import plan_bags
from panoptic_ros.running.plans.bag_topics import BagChoice
from panoptic_ros.running.plans.options import RunOptions
from panoptic_ros.running.runs.result_folder import result_folder
from panoptic_ros.running.runs.results import Results
from panoptic_ros.running.runs.run import RunObserver, run

FRAMES = 6


@pytest.fixture
def bag(tmp_path):
    return write_bag(tmp_path / "bag", captures.views(FRAMES))


class Diary(RunObserver):
    def __init__(self):
        self.lines = []

    def started(self, plan):
        self.lines.append("started")

    def saw(self, key, record):
        self.lines.append(key)

    def judged(self, notices):
        self.lines.append("judged")

    def ended(self):
        self.lines.append("ended")


def test_a_plan_is_run_and_says_nothing_by_itself(bag, tmp_path, capfd):
    outcome = run(plan_bags([bag]), tmp_path / "out", in_process=True, pictures=False)
    assert capfd.readouterr() == ("", "")
    assert outcome.fault is None and outcome.report.summary.frames == FRAMES
    assert outcome.files == ("bag", "report.json", "skeletons.json.gz")
    assert {path.name for path in (tmp_path / "out").iterdir()} == set(outcome.files)
    assert json.loads((tmp_path / "out" / "report.json").read_text()) == outcome.report.document()


def test_an_observer_is_told_the_course_in_order(bag, tmp_path):
    diary = Diary()
    run(plan_bags([bag]), tmp_path / "out", in_process=True, pictures=False, observer=diary)
    seen = diary.lines
    assert (seen[0], seen[-2:]) == ("started", ["ended", "judged"])
    assert seen.count("skeletons") == FRAMES and seen.count("detections") == FRAMES * len(captures.RIG)


def test_what_the_options_say_is_in_the_plan(bag, tmp_path):
    names = captures.RIG.names[:2]
    options = RunOptions({"tracking": {"memory": 0.5}}, model="movenet-multipose")
    plan = plan_bags([bag], RunOptions(options.parameters), choice=BagChoice(cameras=names))
    assert plan.rig.names == names and plan.configs["tracking"].memory == 0.5
    assert options.all_parameters() == {
        "tracking": {"memory": 0.5},
        "detection": {"model": "movenet-multipose"},
    }
    assert options.parameters == {"tracking": {"memory": 0.5}}
    with pytest.raises(UsageError, match="--model"):
        plan_bags([bag], options)


def test_a_rig_goes_before_the_one_of_the_bag(bag, tmp_path):
    path = tmp_path / "rig.json"
    write_rig(path, captures.RIG.subset(captures.RIG.names[1:]))
    assert plan_bags([bag], rig=path).rig.names == captures.RIG.names[1:]


def test_results_keep_previews_of_images(bag, tmp_path):
    with result_folder(tmp_path / "out") as folder, Results(folder, plan_bags([bag])) as results:
        for number in range(30):
            image = np.full((48, 64, 3), number, np.uint8)
            results.take("image", ViewFrame(captures.RIG.names[0], number * 33_333_333, number, image))
    with BagReader(tmp_path / "out" / "bag") as kept:
        topic = "/" + TOPICS["preview"].of(captures.RIG.names[0])
        previews = [from_message(message, "Preview") for _, _, message in kept.messages(topic)]
    assert len(previews) == 10 and {preview.camera for preview in previews} == {captures.RIG.names[0]}


def slow_views_in_turn():
    return [
        captures.view(camera, k, round(1e8 * (k + 0.25 * c)))
        for k in range(15)
        for c, camera in enumerate(captures.RIG.cameras)
    ]


def test_slow_cameras_in_turn_are_told_the_command_once(tmp_path, capfd):
    bag = write_bag(tmp_path / "bag", slow_views_in_turn())
    outcome = run(plan_bags([bag]), tmp_path / "out", in_process=True, pictures=False)
    (text,) = [notice.text for notice in outcome.report.notices if "continuous" in notice.text]
    out = tmp_path / "out"
    assert text.startswith("cameras of 10.0 Hz expose 75 ms apart")
    assert text.endswith(f"`panoptic continuous --bag {out}/bag --out {out}/continuous.json.gz`")
    assert outcome.report.table().count("panoptic continuous") == 1 and capfd.readouterr() == ("", "")
    command = ["continuous", "--bag", str(out / "bag"), "--out", str(out / "continuous.json.gz")]
    assert main(command) == 0


def test_people_at_any_instant_are_in_a_file_that_evaluate_compares(tmp_path):
    bag, out = write_bag(tmp_path / "bag", slow_views_in_turn()), tmp_path / "out"
    plan = plan_bags([bag], RunOptions(parameters={"continuous": {"active": True, "rate_hz": 10.0}}))
    outcome = run(plan, out, in_process=True, pictures=False)
    (text,) = [notice.text for notice in outcome.report.notices if "continuous" in notice.text]
    assert f"use {out}/skeletons_at.json.gz or `panoptic continuous" in text
    assert "skeletons_at.json.gz" in outcome.report.files
    frames = read_skeletons(out / "skeletons_at.json.gz").frames
    with BagReader(out / "bag") as kept:
        sets = [from_message(said, "RefinedPoseSet") for _, _, said in kept.messages("/skeletons_at")]
    assert [frame.stamp_ns for frame in frames] == [item.stamp_ns for item in sets]
    assert [frame.ids.tolist() for frame in frames] == [item.ids.tolist() for item in sets]
    scores = evaluate(out / "skeletons.json.gz", out / "skeletons_at.json.gz").values
    assert scores["same_ids"] == 1.0 and scores["person_recall"] > 0.6


def test_fast_cameras_are_not(bag, tmp_path):
    outcome = run(plan_bags([bag]), tmp_path / "out", in_process=True, pictures=False)
    assert not any("continuous" in notice.text for notice in outcome.report.notices)
