"""Recorded samples of devices that fail: one line each, and the others as they were."""

import numpy as np
import pytest

from panoptic_ros.domain.subjects import ImuSeries
from panoptic_ros.geometry.rotations import rotations_of, to_quaternions, vectors_of
from panoptic_ros.kinematics.imus.recorded import looked_through

COUNT, TIME = 300, (1_000_000_000, 6_000_000_000)


def series(count=COUNT, rate=60.0, first=TIME[0]):
    stamps = first + np.round(np.arange(count) * 1e9 / rate).astype(np.int64)
    quaternions = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
    return ImuSeries(stamps, quaternions, np.zeros((count, 3)), np.tile([0.0, 0.0, 9.81], (count, 1)))


def spoilt(**changes):
    return ImuSeries(**(vars(series()) | changes))


def some(values, rows, value):
    changed = values.copy()
    changed[rows] = value
    return changed


GOOD = series()
CASES = {
    "dies": (ImuSeries(*(part[:120] for part in vars(GOOD).values())), "is silent for 3.0 s", True),
    "pauses": (
        ImuSeries(*(np.delete(part, np.s_[100:200], axis=0) for part in vars(GOOD).values())),
        "is silent for 1.7 s, 1.7 s after its first",
        True,
    ),
    "floods": (series(COUNT * 40, 2400.0), "more than 500 samples/s; 9600 are left out", True),
    "NaN": (
        spoilt(quaternions=some(GOOD.quaternions, np.s_[10:200:2], np.nan)),
        "no orientation in 95 of 300",
        True,
    ),
    "zeros": (spoilt(quaternions=some(GOOD.quaternions, 7, 0.0)), "no orientation in 1 of 300", True),
    "g": (spoilt(forces=GOOD.forces / 9.81), "mean force of [0. 0. 1.]", False),
    "no gravity": (spoilt(forces=0.0 * GOOD.forces), "mean force of [0. 0. 0.]", False),
    "z down": (spoilt(forces=-GOOD.forces), "mean force of [ 0.   0.  -9.8]", False),
    "one sample": (ImuSeries(*(part[:1] for part in vars(GOOD).values())), "has 1 samples", False),
    "other time": (series(first=10**18), "no samples in the time of the cameras", False),
}


@pytest.mark.parametrize("kind", CASES)
def test_a_device_that_fails_is_told_in_a_line_and_harms_nobody(kind):
    bad, told, kept = CASES[kind]
    found, lines = looked_through({"arm": bad, "back": GOOD}, TIME)
    assert ("arm" in found) is kept
    assert [line for line in lines if told in line] and all(line.startswith("arm ") for line in lines)
    assert len(lines) == 1
    for name, part in vars(GOOD).items():
        np.testing.assert_array_equal(getattr(found["back"], name), part)


def test_the_same_of_several_devices_is_one_line():
    bad = spoilt(forces=0.0 * GOOD.forces)
    found, lines = looked_through({"arm": bad, "leg": bad, "back": GOOD}, TIME)
    assert list(found) == ["back"] and len(lines) == 1 and lines[0].startswith("arm, leg measures")


def turning(unit):
    """An arm that waves, its gyroscope's rates in units of so many rad/s."""
    times = np.arange(COUNT) / 60.0
    frames = rotations_of(np.column_stack([0.3 * np.sin(2 * times), 0 * times, 1.5 * np.sin(3 * times)]))
    rates = 60.0 * vectors_of(np.ascontiguousarray(frames[:-1].swapaxes(1, 2) @ frames[1:]))
    rates = np.concatenate([rates, rates[-1:]]) / unit
    forces = frames.swapaxes(1, 2) @ [0.0, 0.0, 9.81]
    return spoilt(quaternions=to_quaternions(frames), rates=rates, forces=forces)


@pytest.mark.parametrize(("way", "kept"), [(1.0, True), (-1.0, False)])
def test_quaternions_the_other_way_round_contradict_the_gyroscope(way, kept):
    arm = turning(1.0)
    arm.quaternions[:, 1:] *= way
    found, lines = looked_through({"arm": arm}, TIME)
    assert ("arm" in found) is kept and len(lines) == (not kept)


@pytest.mark.parametrize(
    ("unit", "told"), [(np.pi / 180, "deg/s"), (180 / np.pi, "converted from deg twice")]
)
def test_rates_of_another_unit_are_told_and_harm_nobody(unit, told):
    found, lines = looked_through({"arm": turning(unit), "leg": turning(unit), "back": turning(1.0)}, TIME)
    assert set(found) == {"arm", "leg", "back"}
    assert len(lines) == 1 and lines[0].startswith("arm, leg sends angular velocities") and told in lines[0]


def test_good_devices_are_not_talked_about():
    found, lines = looked_through({"arm": series(500, 100.0), "back": GOOD}, None)
    assert len(found) == 2 and not lines
