"""Lags of whole recordings: chains, drift, and recordings of which a piece is missing."""

import numpy as np

from panoptic_ros.offsets.sound.matching import RATE
from panoptic_ros.offsets.sound.passes import CoarseLags

LENGTH = 30_000  # frames: five minutes


def world(seed=0):
    """Onsets of mean 0 in three bands."""
    rng = np.random.default_rng(seed)
    values = (rng.random((LENGTH + 4000, 3)) < 0.03) * rng.random((LENGTH + 4000, 3))
    return (values - values.mean()).astype(np.float32)


def heard(true, begin, drift=0.0):
    """What a device has whose recording begins at a frame, and whose clock runs too fast."""
    rows = begin + np.round(np.arange(LENGTH - 3000) / (1.0 + drift)).astype(int)
    noise = 0.1 * np.random.default_rng(begin + 1).standard_normal((len(rows), 3))
    return (true[rows] + noise).astype(np.float32)


def compared(*rises):
    coarse = CoarseLags(rises)
    for a in range(len(rises)):
        for b in range(a + 1, len(rises)):
            coarse.compare(a, b)
    return coarse, *coarse.lines()


def test_offsets_and_drifts_of_minutes_are_found():
    true = world()
    coarse, lines, members = compared(heard(true, 0), heard(true, 2500, 1e-4), heard(true, 700, -8e-5))
    assert members.tolist() == [0, 1, 2] and not coarse.contradicted
    heard_at = lines.heard(lines.middle + np.array([-80.0, 0.0, 80.0]))
    frames = np.stack([heard_at[0], 25.0 + heard_at[1] / (1.0 + 1e-4), 7.0 + heard_at[2] / (1.0 - 8e-5)])
    assert np.ptp(frames, axis=0).max() < 0.02  # what is heard at one time happened at one time
    assert lines.drifts[1] - lines.drifts[0] < -4e-5 and lines.drifts[2] - lines.drifts[0] > 3e-5


def test_a_device_of_which_a_piece_is_missing_is_left_out_and_the_reason_told():
    true = world()
    cut = heard(true, 500)
    cut = np.delete(cut, np.arange(15_000, 15_300), axis=0)
    coarse, lines, members = compared(heard(true, 0), cut, heard(true, 900))
    assert members.tolist() == [0, 2] and np.isnan(lines.offsets[1])
    assert set(coarse.contradicted) == {(0, 1), (1, 2)} and "is sound missing?" in coarse.why[0, 1]
    assert "3.00 s off" in coarse.why[0, 1]


def test_of_two_that_contradict_each_other_none_is_known():
    true = world()
    cut = np.delete(heard(true, 500), np.arange(15_000, 15_300), axis=0)
    _, _, members = compared(heard(true, 0), cut)
    assert not len(members)


def test_what_only_a_third_links_is_one_group():
    true = world()
    early, late = heard(true, 0)[:8000], heard(true, 0)[12_000:20_000]
    _, lines, members = compared(early, late, heard(true, 0)[4000:16_000])
    assert members.tolist() == [0, 1, 2]
    first = lines.heard(np.array([lines.middle]))[:, 0]
    assert np.allclose(first - first[0], [0.0, -12_000 / RATE, -4000 / RATE], atol=0.02)
