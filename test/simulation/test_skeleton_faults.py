"""Faults on true joints are those that are asked for."""

import numpy as np

from panoptic_ros.simulation.skeleton_faults import with_faults

NAMES = ("Neck", "lWrist", "rWrist", "lHip")


def test_noise_outliers_and_gaps_are_as_stated_and_the_seed_decides():
    truth = [{5: np.zeros((4, 3)) + k, 9: np.ones((4, 3)) + k} for k in range(400)]
    faulty = with_faults(truth, NAMES, 3)
    pairs = zip(faulty.joints, truth)
    off = np.array([[own[person] - true[person] for person in (5, 9)] for own, true in pairs])
    missing = np.isnan(off[..., 0])
    assert not missing[..., [0, 3]].any()
    assert missing.sum() == len(faulty.gaps) and 8 * 5 <= len(faulty.gaps) <= 8 * 15
    lengths = np.linalg.norm(off, axis=-1)[~missing]
    far = lengths > 0.09
    assert abs(far.mean() - 0.05) < 0.015 and abs(np.median(lengths[far]) - 0.15) < 0.01
    assert abs(np.sqrt((lengths[~far] ** 2).mean()) - 0.02) < 0.001
    again = with_faults(truth, NAMES, 3)
    assert all(np.array_equal(a[5], b[5], equal_nan=True) for a, b in zip(faulty.joints, again.joints))
    assert with_faults(truth, NAMES, 4).gaps != faulty.gaps
