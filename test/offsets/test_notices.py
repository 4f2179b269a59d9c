"""What is told about clocks while they are found."""

from dataclasses import replace

import numpy as np

from panoptic_ros.offsets.clocks import CameraClocks
from panoptic_ros.offsets.stage import ClockNotices

NAMES = ("a", "b", "c")


def clocks(known, offsets=(0.02, -0.02, 0.0)):
    return replace(
        CameraClocks.unknown(NAMES, 0),
        offsets=np.array(offsets),
        known=np.array(known),
        covariance=np.diag([1e-7] * 3 + [1e-10] * 3),
    )


def told(notices):
    return [(notice.code, notice.text) for notice in notices]


def test_each_correction_is_told_once_and_again_after_a_jump():
    notices, still = ClockNotices(NAMES), np.zeros(3)
    ((code, text),) = told(notices.of(clocks([True, False, True]), still, 2.0))
    assert code == "offsets.corrected" and "a +20.0 ms +- 0.3" in text and "b" not in text.split("motion")[1]
    ((_, text),) = told(notices.of(clocks([True, True, True]), still, 2.0))
    assert "b -20.0 ms" in text and "a +" not in text
    assert notices.of(clocks([True, True, True]), still, 2.0) == ()
    (jump,) = notices.of(clocks([True, True, True]), np.array([0.02, 0.0, 0.0]), 2.0)
    assert jump.code == "offsets.jump" and jump.values == {"camera": "a", "jump_s": -0.02}
    ((code, text),) = told(notices.of(clocks([True, True, True], (0.04, -0.02, 0.0)), still, 2.0))
    assert code == "offsets.corrected" and "a +40.0 ms" in text and "b" not in text.split("motion")[1]


def test_cameras_that_stay_unknown_are_told_once_after_a_while():
    notices, still = ClockNotices(NAMES), np.zeros(3)
    for _ in range(4):
        assert notices.of(clocks([False, False, False]), still, 2.0) == ()
    (notice,) = notices.of(clocks([False, True, False], (0.0, 0.0, 0.0)), still, 2.0)
    assert notice.code == "offsets.unknown" and notice.values == {"cameras": "a, c"}
    assert notices.of(clocks([False, False, False]), still, 2.0) == ()
