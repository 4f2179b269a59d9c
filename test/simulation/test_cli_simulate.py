"""`panoptic simulate` and `panoptic evaluate` from the command line."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from panoptic_ros.cli.main import main
from panoptic_ros.io.bags import BagReader
from panoptic_ros.io.plain_formats import read_detections, read_skeletons
from panoptic_ros.io.rigs import read_rig
from panoptic_ros.running.ltc import decode_file
from panoptic_ros.simulation import SCENES, Lens, Ring

TINY = replace(
    SCENES["rendered-2p4v"], rig=Ring(2, radius=3.9, lens=Lens((96, 72), (64.0, 66.0), 0)), frames=3
)


@pytest.fixture
def tiny_scene(monkeypatch):
    monkeypatch.setitem(SCENES, "tiny", TINY)


def test_a_scene_becomes_files_that_can_be_read(tmp_path, capsys):
    out = tmp_path / "new" / "take"
    assert main(["simulate", "three-views-2p", "--seed", "3", "--frames", "4", "--out", str(out)]) == 0
    assert "3 cameras" in capsys.readouterr().out
    assert sorted(p.name for p in out.iterdir()) == ["detections.json.gz", "rig.json", "truth.json.gz"]
    assert not [p for p in out.parent.iterdir() if p.name.startswith(".")]
    detections, truth = read_detections(out / "detections.json.gz"), read_skeletons(out / "truth.json.gz")
    assert len(detections.frames) == len(truth.frames) == 4
    assert set(detections.frames[0].views) == set(read_rig(out / "rig.json").names)
    first = (out / "detections.json.gz").read_bytes()
    assert main(["simulate", "three-views-2p", "--seed", "3", "--frames", "4", "--out", str(out)]) == 0
    assert (out / "detections.json.gz").read_bytes() == first


def test_a_rendered_scene_becomes_a_capture_folder(tmp_path, tiny_scene):
    assert main(["simulate", "tiny", "--out", str(tmp_path)]) == 0
    names = {p.name for p in tmp_path.iterdir()}
    assert names == {"rig.json", "truth.json.gz", "timestamps.csv", "cam00.mp4", "cam01.mp4"}
    video = cv2.VideoCapture(str(tmp_path / "cam00.mp4"))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 3 and video.read()[1].shape == (72, 96, 3)
    rows = (tmp_path / "timestamps.csv").read_text().splitlines()
    assert rows[:2] == ["camera,frame,stamp_ns", "cam00,0,1000000000"] and len(rows) == 7


def test_sound_tracks_in_place_of_stamps(tmp_path, monkeypatch):
    scene = replace(SCENES["rendered-clocks-2p4v"], rig=TINY.rig, frames=40)
    monkeypatch.setitem(SCENES, "tiny", scene)
    assert main(["simulate", "tiny", "--tracks", "--out", str(tmp_path)]) == 0
    names = {p.name for p in tmp_path.iterdir()}
    assert names == {"rig.json", "truth.json.gz", "sound.yaml", "cam00.mp4", "cam01.mp4"}
    assert (tmp_path / "sound.yaml").read_text() == "cam00.mp4: [A, B]\ncam01.mp4: [B]\n"
    labels = []
    for name, channel, rate in (("cam00", 0, 25), ("cam00", 1, 30 / 1.001), ("cam01", 0, 30 / 1.001)):
        sampled, words = decode_file(tmp_path / f"{name}.mp4", channel)
        starts = [word.start_sample * rate / sampled for word in words]
        assert len(words) > 25 and np.allclose(np.diff(starts), 1.0, atol=2e-3)
        labels.append(str(words[0].timecode))
    assert labels == ["10:00:00:00", "11:00:17:04", "11:00:17:06"]


def test_images_and_depth(tmp_path, tiny_scene):
    assert main(["simulate", "tiny", "--images", "--depth", "--out", str(tmp_path)]) == 0
    image = cv2.imread(str(tmp_path / "cam01" / "000002.png"))
    depth = cv2.imread(str(tmp_path / "cam01_depth" / "000002.png"), cv2.IMREAD_UNCHANGED)
    people = cv2.imread(str(tmp_path / "cam01_people" / "000002.png"), cv2.IMREAD_UNCHANGED)
    assert image.shape == (72, 96, 3) and depth.dtype == np.uint16 and set(np.unique(people)) <= {0, 1, 2}
    assert 1000 < depth[people > 0].min() and depth.max() < 15_000


def test_the_scenes_are_listed(capsys):
    assert main(["simulate", "--list"]) == 0
    text = capsys.readouterr().out
    assert all(name in text for name in SCENES)


@pytest.mark.parametrize(
    "arguments",
    [
        ["simulate"],
        ["simulate", "picnic", "--out", "OUT"],
        ["simulate", "crossing", "--seed", "-1", "--out", "OUT"],
        ["simulate", "crossing", "--frames", "0", "--out", "OUT"],
        ["simulate", "crossing", "--depth", "--out", "OUT"],
        ["simulate", "crossing", "--out", "FILE"],
        ["simulate", "crossing", "--out", "FILE/below"],
        ["evaluate", "MISSING", "MISSING"],
        ["evaluate", "FILE", "FILE"],
    ],
)
def test_mistakes_are_one_line_and_leave_nothing(tmp_path, capsys, arguments):
    (tmp_path / "file").write_text("hello")
    names = {"OUT": tmp_path / "out", "FILE": tmp_path / "file", "MISSING": tmp_path / "none.json"}
    words = [str(names[w.split("/")[0]]) + w[4:] if w.split("/")[0] in names else w for w in arguments]
    words = [w.replace("none.jsonING", "none.json") for w in words]
    assert main(words) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1 and message.startswith(f"panoptic {arguments[0]}: ")
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_an_interrupted_simulation_leaves_nothing(tmp_path, monkeypatch, capsys):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("panoptic_ros.running.simulations.takes.write_detections", interrupt)
    assert main(["simulate", "crossing", "--out", str(tmp_path / "out")]) == 2
    assert not list(tmp_path.iterdir())


def test_truth_against_itself(tmp_path, capsys):
    main(["simulate", "crossing", "--frames", "5", "--out", str(tmp_path)])
    capsys.readouterr()
    truth = str(tmp_path / "truth.json.gz")
    assert main(["evaluate", truth, truth, "--json", "--minimum", "idf1=1", "--maximum", "mpjpe_mm=0.1"]) == 0
    scores = json.loads(capsys.readouterr().out)
    assert scores["person_recall"] == 1.0 and scores["frames"] == 5
    assert main(["evaluate", truth, truth, "--skip", "2", "--plots", str(tmp_path / "plots")]) == 0
    assert "3 of 3 have a result" in capsys.readouterr().out
    plots = sorted(p.name for p in (tmp_path / "plots").iterdir())
    assert plots == ["error_by_joint.png", "error_over_time.png", "identities.png", "pck.png"]
    assert main(["evaluate", truth, truth, "--minimum", "idf1=1.1"]) == 2
    assert "idf1 is 1, not at least 1.1" in capsys.readouterr().err
    assert main(["evaluate", truth, truth, "--protocol", "pcp-voxelpose"]) == 2


@pytest.mark.parametrize("name", ["clean-4p5v", "unsync-5v", "mixed-rates"])
def test_2d_people_also_come_as_a_bag(tmp_path, name):
    """Simulations begin at 0, before which bags have no time."""
    assert main(["simulate", name, "--frames", "3", "--bag", "--out", str(tmp_path / "take")]) == 0
    with BagReader(tmp_path / "take" / "bag") as bag:
        assert "/rig" in bag.topics and sum(topic.endswith("/detections") for topic in bag.topics) > 3


def test_a_body_is_as_long_as_asked(tmp_path, capsys):
    assert main(["simulate", "body-shake", "--frames", "7", "--out", str(tmp_path / "body")]) == 0
    assert "7 frames" in capsys.readouterr().out
    assert main(["simulate", "body-shake", "--frames", "1", "--out", str(tmp_path / "none")]) == 2
    assert "1 frames: a body" in capsys.readouterr().err and not (tmp_path / "none").exists()
