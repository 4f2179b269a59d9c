"""Clocks from sound in words, and where motion contradicts them."""

from dataclasses import replace

import numpy as np

from panoptic_ros.offsets.clocks import CameraClocks
from panoptic_ros.offsets.sound import PairSound, SoundClockEstimate
from panoptic_ros.view.clock_lines import contradictions, pair_lines, sound_lines

NAMES = ("a", "b", "c", "d")


def clocks(offsets, deviation, known=(True, True, True, True)):
    variances = np.concatenate([np.full(4, deviation**2), np.full(4, 1e-10)])
    return replace(
        CameraClocks.unknown(NAMES, 0),
        offsets=np.array(offsets),
        known=np.array(known),
        covariance=np.diag(variances),
    )


def heard(known=(True, True, True, True)):
    pairs = (PairSound("a", "b", True, 9, 8), PairSound("a", "d", False, why="it repeats"))
    found = clocks([0.0, 7.25, 0.002, 0.0], 0.006, known)
    return SoundClockEstimate(found, pairs, {"d": "it repeats"}, 0.017, True, np.zeros(4, np.int64))


def test_every_camera_has_a_line_that_says_what_is_done():
    lines = sound_lines(heard((True, True, True, False)))
    assert "+7.2500 s" in lines[2] and "+- 6.0 ms" in lines[2]
    assert "no more than chance; stamps kept" in lines[3] and "not known: it repeats; stamps kept" in lines[4]
    assert "17 ms" in lines[5]
    assert [line.strip() for line in pair_lines(heard())] == [
        "a and b: agree in 8 of 9 windows of 2 s",
        "a and d: not compared: it repeats",
    ]


def test_motion_beyond_what_sound_leaves_open_is_one_line_for_its_camera():
    assert contradictions(heard(), clocks([0.004, -0.006, 0.002, 0.0], 2e-4)) == []
    told = contradictions(heard(), clocks([0.0, 0.003, 0.060, -0.002], 2e-4))
    assert len(told) == 1 and "the clock of c from motion is +58 ms off" in told[0]
    assert contradictions(heard((True, True, False, True)), clocks([0.0, 0.0, 0.060, 0.0], 2e-4)) == []
