"""Detection in several threads gives what one gives, in the same order, and ends with its recording."""

import threading
import time

import numpy as np
import pytest
from blobs import Blobs
from stage_cases import CELLS, content, detector

from panoptic_ros.detection.config import DetectionConfig
from panoptic_ros.detection.stage import DetectionStage
from panoptic_ros.domain import DepthFrame, ViewFrame
from panoptic_ros.errors import DataError
from panoptic_ros.graph import side_by_side
from panoptic_ros.graph.side_by_side import AHEAD, ParallelDetection, PrecomputedDetection, by_stamp
from panoptic_ros.stage import StageContext, StepResult

CAMERAS = ("left", "right", "third")


def frames(count=6, cameras=CAMERAS):
    rng = np.random.default_rng(1)
    pictures = [Blobs.picture((192, 256), 4.0 * CELLS + rng.uniform(-9, 9), 4.0) for _ in range(count)]
    return {name: [Blobs.frame(picture, k, name) for k, picture in enumerate(pictures)] for name in cameras}


def stage():
    return DetectionStage(DetectionConfig(input_side=256, smallest_input=64), detector())


class Slow:
    """Takes its time, differently for every camera; refuses one image."""

    def __init__(self):
        self.together, self.most, self.lock = 0, 0, threading.Lock()

    def step(self, item):
        with self.lock:
            self.together += 1
            self.most = max(self.most, self.together)
        time.sleep(0.002 * (1 + CAMERAS.index(item.camera)))
        with self.lock:
            self.together -= 1
        if (item.camera, item.frame_number) == ("right", 2):
            raise DataError("no good")
        return StepResult((f"{item.camera} {item.frame_number}",))


def looked(work, cameras=CAMERAS, count=6):
    """What a pipeline takes, instant by instant."""
    streams = {name: work.frames(name) for name in cameras}
    row = PrecomputedDetection(DetectionConfig(), StageContext(None, None, {"looks": work}))
    found = []
    for _ in range(count):
        for name in cameras:
            try:
                found.append(row.step(next(streams[name])))
            except DataError as error:
                found.append(str(error))
    assert all(next(stream, None) is None for stream in streams.values())
    return found


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_threads_do_not_change_what_is_found(threads):
    given = frames()
    alone = stage()
    expected = [alone.step(given[name][k]) for k in range(6) for name in CAMERAS]
    with ParallelDetection(
        stage(), {n: iter(f) for n, f in given.items()}, threads, time.perf_counter_ns
    ) as work:
        found = looked(work)
    assert content(tuple(result.outputs for result in found)) == content(
        tuple(result.outputs for result in expected)
    )


def test_cameras_are_looked_at_at_a_time_and_one_camera_in_order():
    slow = Slow()
    with ParallelDetection(slow, {n: iter(f) for n, f in frames().items()}, 3, time.perf_counter_ns) as work:
        found = looked(work)
        assert work.duration_ns > 0
    assert slow.most > 1
    for place, name in enumerate(CAMERAS):
        own = [each if isinstance(each, str) else each.outputs[0] for each in found[place::3]]
        assert own == ["no good" if (name, k) == ("right", 2) else f"{name} {k}" for k in range(6)]


@pytest.mark.parametrize("held", [0, 9])
def test_it_is_never_far_ahead(held, monkeypatch):
    """Two images of each camera wait, or as many of all as the memory is for; one more is in the works."""
    monkeypatch.setattr(side_by_side, "HELD", held * frames(1)["left"][0].image.nbytes)
    taken = dict.fromkeys(CAMERAS, 0)

    def counted(name, items):
        for item in items:
            taken[name] += 1
            yield item

    sources = {name: counted(name, items) for name, items in frames(20).items()}
    with ParallelDetection(Slow(), sources, 3, time.perf_counter_ns) as work:
        next(work.frames("left"))
        time.sleep(0.2)
        assert sum(taken.values()) <= max(AHEAD * len(CAMERAS), held) + len(CAMERAS) + 1


def test_a_fault_of_a_source_is_raised_where_its_images_are_taken():
    def broken():
        yield ViewFrame("left", 1, 0, np.zeros((8, 8, 3), np.uint8))
        raise OSError("the disk is gone")

    with ParallelDetection(Slow(), {"left": broken()}, 2, time.perf_counter_ns) as work:
        images = work.frames("left")
        next(images)
        with pytest.raises(OSError, match="disk"):
            next(images)


def test_it_ends_when_it_is_left_early():
    with ParallelDetection(
        Slow(), {n: iter(f) for n, f in frames(40).items()}, 3, time.perf_counter_ns
    ) as work:
        next(work.frames("left"))
    assert not any(thread.name.startswith("detection-") for thread in threading.enumerate())


def test_depth_maps_belong_to_their_images_in_threads_too():
    given = frames(4, ("left", "right"))
    near = np.full((192, 256), 0.5, np.float32)
    depths = {
        name: [DepthFrame(name, f.stamp_ns + 1_000_000, f.frame_number, near) for f in own]
        for name, own in given.items()
    }
    alone = stage()
    expected = []
    for k in range(4):
        for name in given:
            alone.step(depths[name][k])
            expected.append(alone.step(given[name][k]))
    inputs = {name: by_stamp(iter(given[name]), iter(depths[name])) for name in given}
    with ParallelDetection(stage(), inputs, 2, time.perf_counter_ns) as work:
        found = looked(work, tuple(given), 4)
    assert content(tuple(r.outputs for r in found)) == content(tuple(r.outputs for r in expected))
    assert all(result.outputs[0].limit is not None for result in found)
