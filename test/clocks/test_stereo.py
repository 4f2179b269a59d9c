"""Two timecodes on one recording."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from panoptic_ros.clocks.stereo import align_timecodes
from panoptic_ros.domain import FrameRate, Timecode, TimecodeReading
from panoptic_ros.errors import ClockError

PAL = FrameRate(25, Fraction(25))
NTSC = FrameRate(30, Fraction(30000, 1001))
RATE = 48_000 * (1 + 80e-6)  # the recorder's true rate; nobody knows it


def channel(rate, first, start_s, seconds, speed=0.0, noise=0.0, seed=0):
    """Readings of a generator that runs `speed` fast, from `start_s` of the recording on."""
    rng = np.random.default_rng(seed)
    return [
        TimecodeReading(
            "recorder",
            k,
            Timecode.from_frame_count(first + k, rate),
            RATE * (start_s + float(k / rate.exact) / (1 + speed)) + noise * rng.standard_normal(),
            noise or 0.01,
        )
        for k in range(int(seconds * rate.exact))
    ]


@pytest.mark.parametrize("first", [5_000, 24 * 3600 * 30 - 60])  # the second one crosses midnight
def test_house_clock_and_camera_clock(first):
    house = channel(PAL, 90_000, 0.3, 20, 20e-6)
    camera = channel(NTSC, first, 1.7, 20, -30e-6)
    model = align_timecodes(house, camera, "vga")
    for k in (0, 300, 500):
        at = 1.7 + float(k / NTSC.exact) / (1 - 30e-6)
        truth = Fraction(90_000, 25) + Fraction((at - 0.3) * (1 + 20e-6))
        device = round(Fraction(first + k) / NTSC.exact * 10**9)
        assert abs(float(model.master_from_device(device)[0] - truth * 10**9)) < 30
    assert model.drift == pytest.approx(50e-6, abs=1e-8)


def test_stated_uncertainty_is_right():
    scaled = []
    for seed in range(40):
        house = channel(PAL, 90_000, 0.0, 10, noise=0.05, seed=seed)
        camera = channel(NTSC, 5_000, 0.0, 10, noise=0.05, seed=100 + seed)
        model = align_timecodes(house, camera, "vga")
        truth = 90_000 / 25 * 1e9 + (model.reference_ns - 5_000 / NTSC.exact * 10**9)
        master, std = model.master_from_device(model.reference_ns)
        scaled.append(float(master - truth) / std)
    assert 0.7 < np.sqrt(np.mean(np.square(scaled))) < 1.4


def swinging(readings):
    """The readings on a tape with wow of 0.5 % at 1 Hz and flutter of 0.2 % at 8 Hz."""
    at = np.array([r.start_sample for r in readings]) / RATE
    swings = [(5e-3, 2 * np.pi * 1.0), (2e-3, 2 * np.pi * 8.0)]
    moved = at + sum(depth / turn * np.sin(turn * at) for depth, turn in swings)
    return [replace(r, start_sample=RATE * t) for r, t in zip(readings, moved)]


@pytest.mark.parametrize(("seconds", "first"), [(4, 5_000), (20, 24 * 3600 * 30 - 60)])
def test_the_speed_of_the_tape_cancels_and_tells_rates(seconds, first):
    """Words of 29.97 Hz that were read as if they were of 30, some or all of them."""
    house = swinging(channel(PAL, 90_000, 0.3, seconds, noise=0.02))
    camera = swinging(channel(NTSC, first, 0.3, seconds, -38e-6, noise=0.02, seed=1))
    for seemed in (0, 40, len(camera)):
        as_read = [
            replace(r, timecode=replace(r.timecode, rate=FrameRate(30, Fraction(30)))) if k < seemed else r
            for k, r in enumerate(camera)
        ]
        model = align_timecodes(house, as_read, "vga")
        middle = round(Fraction(first + len(camera) // 2) / NTSC.exact * 10**9)
        at = float(Fraction(len(camera) // 2) / NTSC.exact) / (1 - 38e-6)
        assert abs(float(model.master_from_device(middle)[0]) - (3600.0 + at) * 1e9) < 4000
        assert model.drift == pytest.approx(38e-6, abs=1e-6)


def test_words_that_the_master_lacks_are_not_guessed():
    house = swinging(channel(PAL, 90_000, 0.0, 20, noise=0.02))
    house = house[:100] + house[150:]
    model = align_timecodes(house, swinging(channel(NTSC, 5_000, 0.0, 20, noise=0.02)), "vga")
    assert abs(model.drift) < 1e-6


def test_what_cannot_be_aligned_is_told():
    house = channel(PAL, 90_000, 0.0, 5)
    with pytest.raises(ClockError, match="vga are too few"):
        align_timecodes(house, house[:2], "vga")
    with pytest.raises(ClockError, match="same time"):
        align_timecodes(house, channel(PAL, 0, 8.0, 5), "vga")
