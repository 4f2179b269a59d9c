"""`panoptic sync report`: what it says of captures with known faults."""

import json
from fractions import Fraction

import numpy as np
import pytest

from panoptic_ros.cli.main import main
from panoptic_ros.domain import (
    AudioBlock,
    FrameRate,
    Preview,
    SkeletonModel,
    Timecode,
    TimecodeReading,
    ViewDetections,
)
from panoptic_ros.io.bags import BagWriter
from panoptic_ros.io.messages import bag_messages, to_message
from panoptic_ros.simulation.ltc_signal import encode_ltc

START = 1_700_000_000


def write(path, streams, caliscope=False):
    """A table of {camera: times in s}."""
    with open(path, "w") as file:
        file.write("sync_index,cam_id,frame_time\n" if caliscope else "camera,frame,stamp_ns\n")
        for name, times in streams.items():
            for k, time in enumerate(times):
                row = (
                    (0, name, f"{START % 10000 + time:.7f}")
                    if caliscope
                    else (name, k, START * 10**9 + round(1e9 * time))
                )
                file.write(",".join(map(str, row)) + "\n")
    return path


def even(rate, seconds=20.0, phase=0.003, jitter=2e-5, seed=0):
    rng = np.random.default_rng(seed)
    count = int(rate * seconds)
    return phase + np.arange(count) / rate + jitter * rng.standard_normal(count)


def report(source, capsys, *more):
    code = main(["sync", "report", str(source), "--json", *more])
    return code, json.loads(capsys.readouterr().out)


def codes(document):
    return sorted(note["code"].partition(".")[2] for note in document["notices"])


def test_a_triggered_rig_is_fine(tmp_path, capsys):
    folder = tmp_path / "capture"
    folder.mkdir()
    write(folder / "timestamps.csv", {c: even(30.0, seed=k) for k, c in enumerate("abc")})
    assert main(["sync", "report", str(folder), "--out", str(tmp_path / "out")]) == 0
    text = capsys.readouterr().out
    assert "show no fault of these clocks" in text and "600 sets of 3.00 views" in text
    assert "--offsets-from-motion" in text.splitlines()[-1]  # what stamps cannot tell
    assert (tmp_path / "out" / "sync.png").stat().st_size > 10_000
    document = json.loads((tmp_path / "out" / "sync_report.json").read_text())
    assert document["cameras"][1]["rate_hz"] == pytest.approx(30.0, abs=1e-4)
    assert abs(document["cameras"][1]["phase_ms"]) < 0.05


def test_what_is_wrong_is_named(tmp_path, capsys):
    rng = np.random.default_rng(3)
    streams = {
        "good": even(30.0),
        "drops": even(30.0)[rng.random(600) > 0.05],
        "shifted": even(30.0 * (1 + 40e-6), phase=0.014),
        "slow": even(27.3),
    }
    code, document = report(write(tmp_path / "timestamps.csv", streams), capsys)
    assert code == 2
    assert codes(document) == ["dropped", "mixed_rates", "odd_rate", "out_of_phase"]
    rows = {row["camera"]: row for row in document["cameras"]}
    assert rows["drops"]["lost"] == pytest.approx(30, abs=15)
    assert rows["shifted"]["phase_ms"] == pytest.approx(11.0 - 0.4, abs=0.1)
    assert rows["shifted"]["off_ppm"] == pytest.approx(40.0, abs=0.5)
    assert document["grouping"]["used_twice"] == 0


def test_reading_at_the_pace_of_the_host_and_beats(tmp_path, capsys):
    """Frames of a 29.5 fps camera, read at whole thirtieths of the host's seconds and stamped then."""
    rng = np.random.default_rng(4)
    polls = np.arange(600) / 30.0
    frames = np.arange(1000) / 29.5
    read = frames[np.searchsorted(frames, polls)]
    stamps = np.maximum(polls, read) + rng.gamma(2.0, 1e-3, 600)
    paced = polls + rng.gamma(2.0, 1e-3, 600)
    source = write(tmp_path / "frame_time_history.csv", {"0": np.unique(stamps), "1": paced}, caliscope=True)
    code, document = report(source, capsys)
    assert code == 2 and "paced_by_host" in codes(document) and "beats" in codes(document)
    (note,) = [n for n in document["notices"] if n["code"].endswith("paced_by_host")]
    assert "1" in note["values"]["cameras"] and "driver's stamps" in note["text"]


def test_stamps_that_go_back_and_captures_that_are_too_short(tmp_path, capsys):
    times = even(30.0)
    times[300:] -= 0.5
    code, document = report(write(tmp_path / "timestamps.csv", {"a": times, "b": times[:3]}), capsys)
    assert code == 2 and codes(document) == ["stamps_back", "too_short"]
    assert document["cameras"][0]["stamps_back"] in (14, 15)


def view(camera, stamp):
    skeleton = SkeletonModel("dot", ("a", "b"), 0, ((0, 1),), 0)
    nobody = np.zeros((0, 2, 2)), np.zeros((0, 2)), np.zeros(0)
    return ViewDetections(camera, stamp, 0, (9, 9), skeleton.hash, *nobody)


@pytest.mark.parametrize("declared", [25, 30])
def test_a_bag_with_detections_and_timecode(tmp_path, capsys, declared):
    """With 29.97 fps declared as 30 the mismatch is named."""
    rate = FrameRate(declared, Fraction(declared))
    true = Fraction(25) if declared == 25 else Fraction(30000, 1001)
    family = bag_messages()
    with BagWriter(tmp_path / "bag") as bag:
        for k in range(300):
            stamp = START * 10**9 + round(k * 10**9 / 30)
            for camera in ("left", "right"):
                bag.write(f"/{camera}/detections", stamp, to_message(view(camera, stamp), family))
            word = START * 10**9 + round(k * 10**9 / true * (1 + 20e-6))
            label = Timecode.from_frame_count(90_000 + k, rate)
            reading = TimecodeReading("mic", word, label, k * 1920.0, 0.01)
            bag.write("/mic/timecode", stamp, to_message(reading, family))
    code, document = report(tmp_path / "bag", capsys)
    assert [row["camera"] for row in document["cameras"]] == ["left", "right"]
    (device,) = document["devices"]
    if declared == 25:
        assert code == 0 and device["drift_ppm"] == pytest.approx(-20.0, abs=0.1)
    else:
        assert code == 2 and codes(document) == ["timecode_rate"]
        assert device["drift_ppm"] == pytest.approx(-1019.0, abs=2.0)


@pytest.mark.parametrize("results", [False, True])
def test_previews_of_a_run_are_no_cameras(tmp_path, results, capsys):
    """`panoptic run` records previews at a third of the rate beside the detections."""
    family = bag_messages()
    with BagWriter(tmp_path / "bag") as bag:
        for k in range(60):
            stamp = START * 10**9 + round(k * 10**9 / 30)
            for camera in ("left", "right"):
                bag.write(f"/{camera}/detections", stamp, to_message(view(camera, stamp), family))
                if k % 3 == 0:
                    preview = Preview(camera, stamp, b"\xff\xd8\xff")
                    bag.write(f"/{camera}/preview/compressed", stamp, to_message(preview, family))
    code, document = report(tmp_path if results else tmp_path / "bag", capsys)
    assert code == 0 and [row["camera"] for row in document["cameras"]] == ["left", "right"]


@pytest.mark.parametrize("counted", [True, False])
def test_sound_that_is_missing_in_a_bag_is_told_once(tmp_path, capsys, counted):
    """Two gaps; a count of samples shows them, or else labels and stamps do."""
    signal = encode_ltc(Timecode.from_frame_count(90_000, FrameRate(25, Fraction(25))), 200, 16_000)
    samples, taken = signal.samples.astype(np.float32), 0
    with BagWriter(tmp_path / "bag") as bag:
        for k in range(len(samples) // 512):
            if k in (60, 150, 151):
                continue
            part = samples[512 * k : 512 * (k + 1)]
            first = 512 * k if counted else taken
            block = AudioBlock("mic", START * 10**9 + 32_000_000 * k, first, 16_000, part)
            taken += len(part)
            bag.write("/mic/audio", block.stamp_ns, to_message(block, bag_messages()))
    code, document = report(tmp_path / "bag", capsys)
    (note,) = document["notices"]
    assert code == 2 and note["code"] == "timecode.gap" and note["text"].endswith("(the first of 2)")
    assert "512 samples" in note["text"] and document["devices"][0]["segment"] == 0


def test_bad_sources_are_told_in_one_line(tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    (tmp_path / "x.csv").write_text("a,b\n1,2\n")
    (tmp_path / "y.csv").write_text("camera,frame,stamp_ns\nc,0,soon\n")
    (tmp_path / "z.txt").write_text("")
    for name, words in (
        ("nowhere", "does not exist"),
        ("empty", "no stamps"),
        ("x.csv", "line 1: columns camera"),
        ("y.csv", "line 2"),
        ("z.txt", "not a CSV"),
    ):
        assert main(["sync", "report", str(tmp_path / name)]) == 2
        error = capsys.readouterr().err
        assert words in error and error.count("\n") == 1
