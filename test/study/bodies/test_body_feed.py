"""Bodies that are played to the live graph: what IMUs tell fits the motion, on the way back too."""

import numpy as np
import pytest

from panoptic_ros.geometry.rotations import from_quaternions, vectors_of
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.recorded_motions import read_clips
from panoptic_ros.study.bodies.body_feed import body_feed

SECONDS, RATE = 5.0, 30.0


@pytest.fixture(scope="module")
def feed():
    return body_feed(2, RATE, SECONDS, 3, read_body_model(), read_clips())


def test_there_are_views_and_devices_of_everybody(feed):
    assert len(feed.rig) == 8 and len(feed.subjects) == 2 and len(feed.devices) == 26
    assert len(feed.sets) == pytest.approx(SECONDS * RATE, abs=2) and feed.title.startswith("2 bodies")
    apart = feed.subjects[0].start - feed.subjects[1].start
    assert np.linalg.norm(apart[:2]) > 1.0
    assert all(len(item.views) == 8 for item in feed.sets)


def test_rates_are_those_with_which_orientations_turn_forth_and_back(feed):
    name, count = feed.subjects[0].devices[4].name, 2 * (len(feed.sets) - 1)
    samples = [
        (number * feed.period_ns + offset, sample)
        for number in range(count)
        for offset, sample in feed.samples(number)
        if sample.device == name
    ]
    times = np.array([time for time, _ in samples])
    assert (np.diff(times) > 0).all() and len(samples) == 2 * count
    frames = from_quaternions(np.array([sample.orientation for _, sample in samples]))
    apart = vectors_of(np.ascontiguousarray(frames[:-1].swapaxes(1, 2) @ frames[1:]))
    turned = apart / (1e-9 * np.diff(times))[:, None]
    rates = np.array([sample.rate for _, sample in samples])[:-1]
    for part in (slice(150, len(rates) // 2 - 2), slice(len(rates) // 2 + 2, -150)):
        assert (turned[part] * rates[part]).sum() > 0.9 * (turned[part] ** 2).sum()
