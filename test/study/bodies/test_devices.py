"""Faults of worn devices: what is spoilt is what is said to be, and the table counts it."""

import numpy as np
import pytest

from panoptic_ros.geometry.rotations import from_quaternions, vectors_of
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.recorded_motions import read_clips
from panoptic_ros.simulation.bodies.capture import BodyScene, simulate_body
from panoptic_ros.study.bodies.devices import spoil
from panoptic_ros.study.names import parsed

MODEL = read_body_model()


@pytest.fixture(scope="module")
def take():
    return simulate_body(BodyScene(("02_05",), seconds=6.0, cameras=1), 3, MODEL, read_clips())


def off(take, name, late):
    """Degrees between a device's orientation and that which its segment and true mounting give."""
    segment = next(d.segment for d in take.subject.devices if d.name == name)
    turned = (
        from_quaternions(take.devices[name].quaternions)[-60:]
        if late
        else from_quaternions(take.devices[name].quaternions)[:60]
    )
    frames = take.motion.frames[-60:, segment] if late else take.motion.frames[:60, segment]
    apart = turned.swapaxes(1, 2) @ frames @ take.mounts[name]
    return np.degrees(np.linalg.norm(vectors_of(np.ascontiguousarray(apart)), axis=-1)).mean()


def test_a_wrong_mounting_is_stated_30_degrees_off(take):
    spoilt = spoil(take, "mounting", 4)
    stated = {d.name: d.mount for d in spoilt.capture.subject.devices}
    before = {d.name: d.mount for d in take.subject.devices}
    turned = [np.degrees(np.linalg.norm(vectors_of((stated[n] @ before[n].T)[None]))) for n in stated]
    assert np.allclose(sorted(turned)[-2:], [0.0, 30.0], atol=1e-6)
    assert spoilt.segments == (MODEL.names[take.subject.devices[4].segment],)


def test_a_strap_slips_late_and_its_true_mounting_with_it(take):
    spoilt = spoil(take, "strap", 7)
    name = take.subject.devices[7].name
    assert off(spoilt.capture, name, late=True) < 10.0 < off(spoilt.capture, name, late=False)


def test_exchanged_devices_fit_each_others_segment(take):
    spoilt = spoil(take, "swapped", 0)
    left, right = (
        next(d.name for d in take.subject.devices if MODEL.names[d.segment] == s) for s in spoilt.segments
    )
    assert np.array_equal(spoilt.capture.devices[left].quaternions, take.devices[right].quaternions)
    assert np.array_equal(spoilt.capture.mounts[left], take.mounts[right])


def test_the_table_counts_what_was_told_and_false_alarms():
    row = {
        "kind": "good",
        "segments": [],
        "told_s": None,
        "false": ["strap head"],
        "left_deg": 0.0,
        "heading_deg": 1.0,
        "others_before_deg": 4.0,
        "others_deg": 3.0,
    }
    bad = row | {"kind": "mounting", "segments": ["lShin"], "told_s": 1.0, "false": [], "left_deg": 7.0}
    rows = [row, bad, bad | {"told_s": None, "left_deg": 5.0}]
    rest = row | {"segments": ["lShin"], "false": []}
    rows += [rest | {"kind": kind} for kind in ("swapped", "strap", "heading")]
    lines = [line.split() for line in parsed("devices", []).lines({"rows": rows})]
    assert ["good", "1", "0", "-", "0.0", "(0.0)", "1"] == lines[2][:7] and "strap" in lines[2]
    assert ["mounting", "2", "1", "1.0", "(1.0)", "6.0", "(7.0)", "1"] == lines[3][:8]
