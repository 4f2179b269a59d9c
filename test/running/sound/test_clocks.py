"""Clocks from sound, from a simulated capture to corrected skeletons."""

import json

import numpy as np
import pytest

from panoptic_ros.cli.main import main
from panoptic_ros.io.bag_streams import BagStream
from panoptic_ros.io.clock_files import read_clocks
from panoptic_ros.running.plans.bag_plan import plan_bags
from panoptic_ros.running.plans.options import RunOptions
from panoptic_ros.running.plans.planning import plan_capture
from panoptic_ros.simulation import simulate
from panoptic_ros.simulation.scenes import scene

SCENE, SEED, FRAMES = "own-clocks-3p5v", 4, 45


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    """2D people of cameras whose clocks are seconds apart, and their sound, as files and as a bag."""
    folder = tmp_path_factory.mktemp("own") / "take"
    arguments = ["simulate", SCENE, "--seed", SEED, "--frames", FRAMES, "--bag", "--out", folder]
    assert main([*map(str, arguments)]) == 0
    return folder, simulate(scene(SCENE), SEED, FRAMES)


def behind(take):
    """s, what the stamps of each camera lack in the middle of what is filmed."""
    middle = 0.5 * take.seconds
    return {
        name: 1e-9 * (take.master_ns(middle) - clock.stamp_ns(middle))
        for name, clock in zip(take.rig.names, take.clocks)
    }


def run(capsys, *arguments):
    code = main([*map(str, arguments)])
    captured = capsys.readouterr()
    return code, captured.out, [line for line in captured.err.splitlines() if line.strip()]


@pytest.mark.parametrize("source", ["folder", "bag"])
def test_offsets_of_whole_seconds_are_found_in_files_and_bags_alike(capture, tmp_path, capsys, source):
    folder, take = capture
    given = [folder] if source == "folder" else [folder / "bag", "--rig", folder / "rig.json"]
    out = tmp_path / "offsets.json"
    code, text, _ = run(capsys, "sync", "sound", *given, "--out", out)
    assert code == 0 and "its stamps are kept" in text and "cam00 and cam01: agree" in text
    found, true = read_clocks(out), behind(take)
    assert found.keys() == true.keys() and found["cam00"].offset_s == 0.0
    del found["cam00"]
    for name, offset in found.items():
        assert abs(offset.offset_s - true[name]) < min(0.02, 4.0 * offset.offset_sd_s)
    assert min(offset.offset_s for offset in found.values()) > 0.4
    if source == "bag":  # streams of a run are kept side by side
        plan = plan_bags([folder / "bag"], RunOptions(offsets=out))
        assert {s.camera: s.shift_ns for s in plan.streams if s.camera in found} == {
            name: round(1e9 * offset.offset_s) for name, offset in found.items()
        }
        assert plan.at("cam01", 0) == plan.shifts["cam01"] and plan.at("cam00", 5) == 5


def test_motion_after_sound_gives_skeletons_as_with_right_stamps(capture, tmp_path, capsys):
    folder, take = capture
    out, offsets = tmp_path / "skeletons.json.gz", tmp_path / "offsets.json"
    code, text, _ = run(
        capsys,
        "solve",
        "--rig",
        folder / "rig.json",
        "--detections",
        folder / "detections.json.gz",
        "--offsets-from-sound",
        folder,
        "--offsets-from-motion",
        "--offsets-out",
        offsets,
        "--out",
        out,
    )
    assert code == 0 and "clocks from sound" in text and "clocks from motion" in text
    assert "off that from sound" not in text
    found, true = read_clocks(offsets), behind(take)
    error = np.array([(found[name].offset_s if name in found else 0.0) - true[name] for name in true])
    assert np.abs(error - error.mean()).max() < 0.002
    _, text, _ = run(capsys, "evaluate", folder / "truth.json.gz", out, "--json")
    assert json.loads(text)["mpjpe_mm"] < 4.0


def test_what_cannot_be_found_is_one_line(capture, tmp_path, capsys):
    folder, _ = capture
    empty = tmp_path / "empty"
    empty.mkdir()
    for given, says in (
        ([empty], "has no sound"),
        ([tmp_path / "gone"], "does not exist"),
        ([folder / "rig.json"], "neither a capture"),
        ([folder, "--trusted-camera", "cam99"], "cam99"),
    ):
        code, text, errors = run(capsys, "sync", "sound", *given)
        assert code == 2 and not text and len(errors) == 1 and says in errors[0]
    code, _, errors = run(
        capsys,
        "solve",
        "--rig",
        folder / "rig.json",
        "--detections",
        folder / "detections.json.gz",
        "--offsets",
        folder / "x.json",
        "--offsets-from-sound",
        folder,
        "--out",
        tmp_path / "s.json",
    )
    assert code == 2 and len(errors) == 1 and "not both" in errors[0]


def test_a_run_corrects_the_stamps_of_its_frames(tmp_path):
    folder = tmp_path / "take"
    arguments = ["simulate", "rendered-own-clocks-2p4v", "--seed", 1, "--frames", 6, "--out", folder]
    assert main([*map(str, arguments)]) == 0
    take = simulate(scene("rendered-own-clocks-2p4v"), 1, 6)
    plan = plan_capture(folder, RunOptions(from_sound=True))
    assert any("its stamps are kept" in line for line in plan.notices)
    true = behind(take)
    for name in ("cam01", "cam02", "cam03"):
        line = plan.sources[name]["corrections"][name]
        offset = 1e-9 * line["offset_ns"]
        assert abs(offset - true[name]) < 0.03 and abs(line["drift"]) < 3e-4
    assert "corrections" not in plan.sources["cam00"]


def test_a_run_on_a_bag_corrects_the_stamps_of_its_messages(capture, tmp_path, capsys):
    folder, take = capture
    out, true = tmp_path / "out", behind(take)
    plan = plan_bags([folder / "bag"], RunOptions(from_sound=True))
    shifted = {stream.camera: stream.line for stream in plan.streams if stream.line is not None}
    assert shifted.keys() == true.keys() - {"cam00"}
    for name, line in shifted.items():
        assert abs(1e-9 * line.offset_ns - true[name]) < 0.02 and abs(line.drift) < 3e-4
    assert BagStream.from_words(plan.streams[1].words()) == plan.streams[1]
    code, text, _ = run(
        capsys,
        "run",
        "--bag",
        folder / "bag",
        "--offsets-from-sound",
        "--in-process",
        "--no-pictures",
        "--out",
        out,
    )
    assert code == 0 and "its stamps are kept" in text
    _, text, _ = run(capsys, "evaluate", folder / "truth.json.gz", out / "skeletons.json.gz", "--json")
    assert json.loads(text)["mpjpe_mm"] < 6.0


def test_a_run_without_offsets_says_what_the_sound_is_good_for(capture):
    (line,) = [line for line in plan_bags([capture[0] / "bag"]).notices if "audio" in line]
    assert "and 2 more are not used" in line and "--offsets-from-sound aligns them" in line
