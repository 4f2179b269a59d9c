"""The bags in the repository become skeletons, without a model."""

import json

import pytest

from panoptic_ros.cli.main import main
from panoptic_ros.io.bags import BagReader
from panoptic_ros.io.files import write_json
from panoptic_ros.io.messages import from_message
from panoptic_ros.io.models import DEFAULT_MODEL, is_cached, read_card
from panoptic_ros.io.resources import share_folder
from panoptic_ros.running.evaluate import evaluate
from panoptic_ros.running.plans.bag_plan import plan_bags
from panoptic_ros.running.runs.run import run
from panoptic_ros.simulation import scene, simulate

SAMPLE = share_folder() / "bags" / "sample"
IMAGES = share_folder() / "bags" / "images"
SOUND = share_folder() / "bags" / "sound"


@pytest.mark.skipif(not SAMPLE.is_dir(), reason="the sample bag is part of the checkout only")
def test_sample_bag_gives_two_people_with_one_id_each(tmp_path, monkeypatch):
    monkeypatch.setenv("PANOPTIC_CACHE", str(tmp_path / "no models here"))
    out = tmp_path / "out"
    assert main(["run", "--bag", str(SAMPLE), "--out", str(out), "--in-process"]) == 0
    report = json.loads((out / "report.json").read_text())
    assert [person["frames"] for person in report["people"]] == [60, 60]
    assert report["reprojection_px"]["all"]["median"] < 15.0
    assert (out / "skeletons.png").stat().st_size > 10_000


@pytest.mark.skipif(not SOUND.is_dir(), reason="the sample bag is part of the checkout only")
def test_the_bag_with_sound_has_two_clocks_that_its_timecodes_align(tmp_path):
    plan = plan_bags([SOUND])
    assert plan.devices == ("timecode",) and plan.configs["clocks"].master_clock == "A"
    assert plan.shifts["cam01"] == pytest.approx(-3_656.7375e9, abs=2e5)
    outcome = run(plan, tmp_path / "out", in_process=True, pictures=False)
    assert outcome.report.summary.frames == 30 and not outcome.report.dropped
    write_json(tmp_path / "truth.json", simulate(scene("rendered-clocks-2p4v"), 3, 40).truth_document())
    scores = evaluate(tmp_path / "truth.json", tmp_path / "out" / "skeletons.json.gz").values
    assert scores["mpjpe_mm"] < 20.0  # half a period of a camera would be 20 ms, 3 cm of who walks
    with BagReader(SOUND) as bag:
        (_, _, message), *_ = bag.messages("/cam00/detections")
        assert from_message(message, "ViewDetections").maps is not None


@pytest.mark.skipif(
    not is_cached(read_card(DEFAULT_MODEL)), reason="the default model is not fetched (panoptic models fetch)"
)
def test_the_bag_with_small_images_and_depth_gives_the_people_that_were_simulated(tmp_path):
    plan = plan_bags([IMAGES])
    assert plan.stage == "detection" and plan.depth_cameras == plan.rig.names
    assert {stream.key for stream in plan.streams} == {"compressed_image", "compressed_depth"}
    outcome = run(plan, tmp_path / "out", in_process=True, pictures=False)
    assert outcome.report.summary.frames == 12 and not outcome.report.dropped
    write_json(tmp_path / "truth.json", simulate(scene("rendered-2p4v"), 5, 12).truth_document())
    scores = evaluate(tmp_path / "truth.json", tmp_path / "out" / "skeletons.json.gz").values
    assert scores["person_recall"] == scores["person_precision"] == 1.0 and scores["mpjpe_mm"] < 50.0


@pytest.mark.parametrize("path", [SAMPLE, SOUND, IMAGES], ids=lambda path: path.name)
def test_the_bags_are_small(path):
    assert sum(file.stat().st_size for file in path.iterdir()) < 1_000_000
