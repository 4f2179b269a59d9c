"""How directly two microphones hear: dry beside a talker, with a tail far from him."""

import numpy as np
import pytest
from scipy.signal import oaconvolve, resample_poly

from panoptic_ros.offsets.sound.directness import PARTS, Phases, directness

RATE = 16_000


def source(seed=0):
    return np.random.default_rng(seed).standard_normal((PARTS + 1) * RATE)


def in_room(dry, delay_s, direct, seed):
    """Direct sound, and a tail of energy 1 that falls by 60 dB in half a second."""
    rng, first = np.random.default_rng(seed), round(delay_s * RATE)
    response = np.zeros(first + RATE // 2)
    tail = rng.standard_normal(RATE // 2) * 10.0 ** (-6.0 * np.arange(RATE // 2) / RATE)
    response[first:] = tail / np.linalg.norm(tail)
    response[first] += np.sqrt(direct)
    return oaconvolve(dry, response)[RATE // 2 : RATE // 2 + PARTS * RATE, None]


def phases(*windows, rate=RATE):
    heard = Phases.nothing(len(windows))
    for k, samples in enumerate(windows):
        heard.hear(k, samples, rate)
    return heard


def test_the_same_sound_agrees_wholly_wherever_it_begins():
    dry = source()
    first, second = (dry[begin : begin + PARTS * RATE, None] for begin in (400, 240))
    heights, _ = directness(phases(first), phases(second), np.array([0.0]))
    assert heights[0] > 0.85  # less what the taper weights otherwise
    heights, _ = directness(phases(first), phases(resample_poly(first, 3, 1), rate=3 * RATE), np.array([0.0]))
    assert heights[0] > 0.95


def test_the_tail_lies_on_the_side_of_whom_hears_from_afar():
    dry = source()
    near, far = in_room(dry, 0.002, 4.0, 1), in_room(dry, 0.012, 0.2, 2)
    also = in_room(dry, 0.014, 0.2, 3)
    lags = np.array([0.010])
    height, tail = directness(phases(near), phases(far), lags)
    assert tail[0] > 1.0
    back = directness(phases(far), phases(near), -lags)
    assert back[0] == pytest.approx(height, rel=1e-5) and back[1] == pytest.approx(-tail, rel=1e-3)
    both_far = directness(phases(far), phases(also), np.array([0.002]))
    assert both_far[0][0] < height[0] and abs(both_far[1][0]) < tail[0]


def test_strangers_do_not_agree_and_silence_tells_nothing():
    one, other = source(1)[: PARTS * RATE, None], source(2)[: PARTS * RATE, None]
    silent = np.zeros_like(one)
    lags = np.array([0.0, 0.0, np.nan])
    heights, tails = directness(phases(one, one, one), phases(other, silent, other), lags)
    assert heights[0] < 0.05 and abs(tails[0]) < 1.0
    assert np.isnan(heights[1:]).all() and np.isnan(tails[1:]).all()
    assert not phases(one[::2], rate=RATE // 2).there.any()
