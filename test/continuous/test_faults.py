"""Cameras whose timestamps are far off are found by the motion, and do no harm."""

from dataclasses import replace

import numpy as np
import pytest
from free_cameras import START_NS, FreeCapture

from panoptic_ros.continuous.config import ContinuousConfig
from panoptic_ros.continuous.passes import ContinuousPass
from panoptic_ros.domain import DetectionSet
from panoptic_ros.graph.recording import InMemoryRecording
from panoptic_ros.stage import untold

TIMES = np.arange(0.3, 5.7, 0.05)
SECOND = 1_000_000_000


@pytest.fixture(scope="module")
def capture():
    return FreeCapture(seconds=6.0, speed=2.0)


def moved(capture, camera, shift_s, since_s=0.0):
    """Sets with the timestamps of a camera shifted, in the order of timestamps."""
    found = []
    for item in capture.sets:
        (view,) = item.views
        stamp = view.stamp_ns
        if view.camera == camera and stamp >= START_NS + SECOND * since_s:
            stamp += round(SECOND * shift_s)
        found.append(DetectionSet(0, stamp, item.skeleton_hash, (replace(view, stamp_ns=stamp),)))
    return sorted(found, key=lambda item: item.stamp_ns)


def solved(capture, sets, **options):
    recording = InMemoryRecording({"detection_sets": sets})
    return ContinuousPass(ContinuousConfig(**options), capture.context).run(recording, untold)


@pytest.mark.parametrize("shift_s", [1.0, -0.4])
def test_a_camera_that_is_off_is_left_out_and_named_once(capture, shift_s):
    motion = solved(capture, moved(capture, "cam3", shift_s))
    (notice,) = motion.notices
    assert notice.code == "continuous.clock_off" and "camera cam3" in notice.text
    assert notice.values["offset_s"] == pytest.approx(shift_s, abs=0.03)
    assert f"{abs(shift_s):.2f} s {'ahead of' if shift_s > 0 else 'behind'}" in notice.text
    errors = capture.errors(motion, TIMES)
    assert np.isfinite(errors).all() and errors.mean() < 0.006
    assert motion.last_ns - motion.first_ns < 6.0 * SECOND


def test_a_clock_that_jumps_is_left_out_from_there_on(capture):
    motion = solved(capture, moved(capture, "cam3", 1.0, since_s=3.0))
    (notice,) = motion.notices
    assert "camera cam3 are 1.00 s ahead of those of the other cameras from 2 s on" in notice.text
    errors = capture.errors(motion, TIMES)
    assert np.isfinite(errors).all() and errors.mean() < 0.006


def test_a_camera_whose_stamps_jump_far_is_named_once(capture):
    motion = solved(capture, moved(capture, "cam3", 7.0, since_s=3.0))
    (notice,) = motion.notices
    assert notice.code == "continuous.stray_stamps" and notice.values["views"] == {"cam3": 30}
    errors = capture.errors(motion, TIMES)
    assert np.isfinite(errors).all() and errors.mean() < 0.006


def test_clocks_are_not_spoilt_by_a_camera_that_is_off(capture):
    motion = solved(capture, moved(capture, "cam3", 1.0), clocks=True)
    values, known = motion.clocks.values[0], motion.clocks.observable[0]
    assert [notice.code for notice in motion.notices] == ["continuous.clock_off"]
    assert known.tolist() == [True, True, True, False, True, True] and values[3] == 0.0
    assert np.abs(values).max() < 2e-3


def test_single_views_that_fit_nobody_are_counted_and_do_no_harm():
    def spoil(pixels, rng, camera):
        if rng.random() < 0.03:
            pixels += rng.uniform(-300.0, 300.0, 2)

    capture = FreeCapture(spoil=spoil)
    motion = solved(capture, capture.sets)
    (notice,) = motion.notices
    assert notice.code == "continuous.misfits" and notice.severity == "info"
    assert 3 <= sum(notice.values["views"].values()) <= 20
    errors = capture.errors(motion, TIMES[TIMES < 3.7])
    assert np.isfinite(errors).all() and errors.mean() < 0.006 and len(motion.people) == 2


def test_a_recording_without_faults_has_no_notice(capture):
    assert solved(capture, capture.sets).notices == ()


def test_people_who_stand_give_no_clocks():
    capture = FreeCapture(cameras=4, rate=25.0, seconds=3.0, speed=0.0)
    motion = solved(capture, capture.sets, clocks=True, rolling_shutter=True)
    assert not motion.clocks.observable.any()
    assert not motion.clocks.values.any()
