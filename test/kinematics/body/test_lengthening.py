"""Lengths go over to others smoothly, and arrive."""

import numpy as np
from bodies import BODY

from panoptic_ros.kinematics.body.lengthening import LASTS_S, Lengthening

PERIOD = 1.0 / 60.0


def test_lengths_begin_where_they_were_and_end_where_they_are_to_be():
    begin = 0.9 * BODY.offsets
    change = Lengthening(begin, BODY)
    steps = round(LASTS_S / PERIOD) + 2
    found = np.array([begin, *(change.after(PERIOD).offsets for _ in range(steps))])
    assert change.is_over and np.array_equal(found[-1], BODY.offsets)
    moved = np.linalg.norm(np.diff(found, axis=0), axis=-1)
    assert (moved.sum(0) <= np.linalg.norm(BODY.offsets - begin, axis=-1) + 1e-12).all(), "straight on"
    jumps = np.linalg.norm(np.diff(found, 2, axis=0), axis=-1) / PERIOD**2
    slow = np.pi**2 / (2.0 * LASTS_S**2) * np.linalg.norm(BODY.offsets - begin, axis=-1)
    assert (jumps <= 1.05 * slow + 1e-9).all(), "as half a cosine accelerates"


def test_what_the_detector_sees_of_the_new_body_is_kept():
    found = Lengthening(BODY.offsets, BODY).after(0.1)
    assert found.keypoints is BODY.keypoints and found.own == BODY.own
