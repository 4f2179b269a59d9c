"""--duration counts seconds of the recording, from its first stamp on, whatever is read."""

from __future__ import annotations

import time
from contextlib import ExitStack
from dataclasses import replace

import captures
import numpy as np
import pytest
from recordings import write_bag

from panoptic_ros.capture import open_source
from panoptic_ros.capture.imus import imu_samples
from panoptic_ros.capture.sound import described_sound, open_sound
from panoptic_ros.domain.subjects import ImuSeries
from panoptic_ros.io.bag_streams import BagStream, opened_streams
from panoptic_ros.io.kinematic_files import write_imus
from panoptic_ros.io.plain_formats import read_skeletons
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.io.wav import write_wav
from panoptic_ros.running.plans.bag_plan import plan_bags
from panoptic_ros.running.plans.duration import ended_after
from panoptic_ros.running.plans.planning import plan_capture
from panoptic_ros.running.runs.run import run

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND  # cameras have a wall clock
FRAMES, RATE = 30, 30


def moved(views):
    return [replace(view, stamp_ns=view.stamp_ns + START) for view in views]


@pytest.fixture
def bag(tmp_path):
    return write_bag(tmp_path / "bag", moved(captures.views(FRAMES, RATE)))


@pytest.mark.parametrize(("duration", "frames"), [(0.25, 8), (0.5, 15), (10.0, FRAMES)])
def test_a_run_on_a_bag_has_so_many_seconds(bag, tmp_path, duration, frames):
    outcome = run(plan_bags([bag]), tmp_path / "out", in_process=True, pictures=False, duration_s=duration)
    stamps = [frame.stamp_ns for frame in read_skeletons(tmp_path / "out" / "skeletons.json.gz").frames]
    assert len(stamps) == outcome.report.summary.frames == frames
    assert stamps[0] == START and stamps[-1] < START + round(duration * SECOND)
    assert set(outcome.report.frames_in.values()) == {frames}


def test_a_slow_machine_gives_the_same(bag, tmp_path, monkeypatch):
    real, begun = time.monotonic, time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: begun + 1000.0 * (real() - begun))
    run(plan_bags([bag]), tmp_path / "out", in_process=True, pictures=False, duration_s=0.5)
    assert len(read_skeletons(tmp_path / "out" / "skeletons.json.gz").frames) == 15


def test_streams_of_a_bag_end_alike_whoever_reads_them(bag):
    plan = ended_after(plan_bags([bag]), 0.5)
    streams = [BagStream.from_words(stream.words()) for stream in plan.streams]
    assert {stream.until_ns for stream in streams} == {START + SECOND // 2}
    with ExitStack() as stack:
        for _, records in opened_streams(streams, stack, lambda error: None):
            assert len(list(records)) == 15


def test_stamps_that_jump_do_not_end_a_stream(tmp_path):
    views = moved(captures.views(FRAMES, RATE))
    ahead = [
        replace(view, stamp_ns=view.stamp_ns + 3600 * SECOND) if 8 <= k // 4 < 10 else view
        for k, view in enumerate(views)
    ]
    plan = ended_after(plan_bags([write_bag(tmp_path / "bag", ahead)]), 0.5)
    with ExitStack() as stack:
        for _, records in opened_streams(plan.streams, stack, lambda error: None):
            assert len(list(records)) == 13


def test_images_sound_and_imus_of_a_folder(tmp_path):
    cv2 = pytest.importorskip("cv2")
    rows = ["camera,frame,stamp_ns"]
    for k, camera in enumerate(captures.RIG.cameras[:2]):
        (tmp_path / camera.name).mkdir()
        for index in range(FRAMES):
            image = np.full((720, 1280, 3), index, np.uint8)
            cv2.imwrite(str(tmp_path / camera.name / f"{index:03d}.jpg"), image)
            rows.append(f"{camera.name},{index},{START + 5_000_000 * k + round(index * SECOND / RATE)}")
    (tmp_path / "timestamps.csv").write_text("\n".join(rows) + "\n")
    write_rig(tmp_path / "rig.json", captures.RIG.subset(captures.RIG.names[:2]))
    plan = ended_after(plan_capture(tmp_path), 0.5)
    assert plan.until_ns == START + SECOND // 2 and plan.instants == 15
    for name in plan.rig.names:
        source, _ = open_source(name, plan.rig, plan.sources[name])
        with source:
            assert [frame.frame_number for frame in source] == list(range(15))


def test_sound_and_imus_end_there_too(tmp_path):
    write_wav(tmp_path / "mic.wav", 8000, np.zeros((8000, 1)))
    sound = described_sound("wav", "mic", (), path=str(tmp_path / "mic.wav"), start_ns=START)
    with open_sound({**sound, "until_ns": START + SECOND // 2}) as source:
        assert source.device == "mic"
        assert max(block.stamp_ns for block in source) < START + SECOND // 2
    series = ImuSeries(
        START + np.arange(100) * 10_000_000,
        np.tile([1.0, 0, 0, 0], (100, 1)),
        np.zeros((100, 3)),
        np.tile([0, 0, 9.81], (100, 1)),
    )
    write_imus(tmp_path / "imu.csv", {"back": series})
    assert len(list(imu_samples(tmp_path / "imu.csv", ["back"], START + SECOND // 2))) == 50
    assert len(list(imu_samples(tmp_path / "imu.csv", ["back"]))) == 100
