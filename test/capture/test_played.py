"""A recording played as a live camera: due times, numbers that go on, frames that nobody took in time."""

from itertools import islice

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from panoptic_ros.capture.described import PlaybackSource
from panoptic_ros.domain import ViewFrame

PERIOD = 40_000_000


class Film:
    """Five frames that tell their place."""

    camera, image_size, frame_rate, frame_count = "a", (8, 8), 60.0, 5

    def __iter__(self):
        for k in range(5):
            yield ViewFrame("a", k, k, np.full((8, 8, 3), 40 * k, np.uint8))

    def close(self):
        pass


class Clock:
    def __init__(self, now):
        self.now = now

    def __call__(self):
        return self.now

    def wait(self, seconds):
        self.now += round(1e9 * seconds)


def played(now, start=1000, most_kept=0):
    clock = Clock(now)
    return PlaybackSource(Film(), 25.0, start, clock, clock.wait, most_kept), clock


@given(behind=st.integers(0, 40 * PERIOD))
def test_cameras_of_one_start_give_the_same_frames_whenever_they_begin(behind):
    source, clock = played(1000 + behind)
    for frame in islice(iter(source), 12):
        assert frame.stamp_ns == 1000 + frame.frame_number * PERIOD
        assert clock.now >= frame.stamp_ns >= 1000 + behind
        assert (frame.image == 40 * (frame.frame_number % 5)).all()


@given(behind=st.integers(0, 40 * PERIOD))
def test_a_short_recording_is_kept_and_played_forth_and_back(behind):
    source, clock = played(1000 + behind, most_kept=10_000)
    for frame in islice(iter(source), 20):
        assert frame.stamp_ns == 1000 + frame.frame_number * PERIOD
        assert clock.now >= frame.stamp_ns >= 1000 + behind
        place = frame.frame_number % 8
        shown = min(place, 8 - place)
        assert np.abs(frame.image.astype(int) - 40 * shown).max() <= 3


def test_what_nobody_takes_in_time_is_left_out_by_its_number():
    source, clock = played(1000)
    frames = iter(source)
    numbers = [next(frames).frame_number]
    clock.now += 4 * PERIOD
    numbers += [next(frames).frame_number for _ in range(3)]
    assert numbers == [0, 2, 3, 4]


def test_it_ends_when_it_is_closed():
    source, _ = played(1000)
    frames = iter(source)
    next(frames)
    source.close()
    assert list(frames) == []
