"""Frames grouped anew by corrected stamps."""

import numpy as np

from panoptic_ros.offsets.regroup import regroup


def test_without_corrections_nothing_changes(make_capture):
    sets = make_capture(seconds=0.3).sets
    again = regroup(sets, {v.camera: np.zeros(len(sets)) for v in sets[0].views})
    for before, after in zip(sets, again):
        assert [v.camera for v in before.views] == [v.camera for v in after.views]
        assert [v.stamp_ns for v in before.views] == [v.stamp_ns for v in after.views]


def test_a_shifted_camera_moves_to_other_sets_and_is_used_once(make_capture):
    sets = make_capture(seconds=0.5).sets
    shifts = {v.camera: np.zeros(len(sets)) for v in sets[0].views}
    name = sets[0].views[1].camera
    shifts[name] += 2e9 / 30.0 + 3e6
    again = regroup(sets, shifts)
    numbers = [v.frame_number for item in again for v in item.views if v.camera == name]
    assert numbers == list(range(len(sets) - 2))
    moved = next(v for v in again[5].views if v.camera == name)
    assert moved.frame_number == 3 and abs(moved.stamp_ns - again[5].stamp_ns - 3e6) < 10
    assert all(v.camera != name for v in again[0].views)
