"""Live cameras in one process: the newest instant, until somebody stops or a camera fails."""

import threading
import time
from dataclasses import dataclass
from types import SimpleNamespace

import pytest

from panoptic_ros.errors import BackendError
from panoptic_ros.running.runs.in_process import newest_frames


@dataclass(frozen=True)
class Frame:
    camera: str
    stamp_ns: int


def no_drop(count):
    raise AssertionError(f"{count} dropped")


def test_views_of_one_instant_come_together():
    def frames(camera):
        for i in range(3):
            barrier.wait()
            yield Frame(camera, 100 * i)
            taken.wait()

    barrier, taken = threading.Barrier(2), threading.Barrier(3)
    got = []
    for frame in newest_frames("ab", frames, lambda: False, no_drop):
        got.append((frame.stamp_ns, frame.camera))
        if len(got) % 2 == 0:
            taken.wait()
    assert got == [(100 * i, camera) for i in range(3) for camera in "ab"]


def test_frames_that_are_overtaken_are_counted():
    ready, drops = threading.Event(), []

    def frames(camera):
        for i in range(10):
            yield Frame(camera, i)
        if camera == "b":
            ready.set()

    source = newest_frames("ab", frames, lambda: not ready.wait(5.0), drops.append)
    frames_taken = list(source)
    assert len(frames_taken) + sum(drops) <= 20 and sum(drops) > 0
    assert frames_taken[-1].stamp_ns == 9


def test_stops_although_nothing_comes():
    end = time.monotonic() + 0.3
    forever = threading.Event()

    def frames(camera):
        forever.wait(10.0)
        yield from ()

    assert list(newest_frames("ab", frames, lambda: time.monotonic() > end, no_drop)) == []
    assert time.monotonic() < end + 3.0
    forever.set()


def test_a_camera_that_fails_ends_it():
    def frames(camera):
        yield Frame(camera, 0)
        if camera == "b":
            raise BackendError("b: it gives no more images")
        threading.Event().wait(1.0)

    with pytest.raises(BackendError, match="b: "):
        list(newest_frames("ab", frames, lambda: False, no_drop))


def test_no_sound_is_dropped_and_its_end_ends_nothing():
    """However many frames are overtaken."""
    heard_all = threading.Event()

    def frames(camera):
        heard_all.wait(10.0)
        yield SimpleNamespace(stamp_ns=1, name=camera)

    def sound():
        yield from range(500)

    taken = []
    for item in newest_frames(["a", "b"], frames, lambda: False, lambda count: None, [sound]):
        taken.append(item)
        if item == 499:
            heard_all.set()
    assert taken[:500] == list(range(500)) and {item.name for item in taken[500:]} == {"a", "b"}
