"""A part of a recording is found where it is, and nowhere else."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.offsets.sound.matching import RATE, find


def onsets(seed, count, bands=3):
    """Sparse onsets, of mean 0."""
    rng = np.random.default_rng(seed)
    values = (rng.random((count, bands)) < 0.05) * rng.random((count, bands))
    return (values - values.mean()).astype(np.float32)


@settings(max_examples=20, deadline=None)
@given(st.integers(-400, 2400), st.integers(0, 1000))
def test_a_part_is_found_at_its_lag_also_where_it_lies_half_outside(begin, seed):
    whole = onsets(seed, 3000)
    part = onsets(seed + 1, 1000)
    inside = np.arange(max(0, begin), min(3000, begin + 1000))
    part[inside - begin] = whole[inside]
    found = find(part, whole)
    assert found.unique and abs(found.lag - begin / RATE) < 0.5 / RATE
    near = find(part, whole, near=begin / RATE + 0.2, within=0.5)
    assert abs(near.lag - begin / RATE) < 0.5 / RATE and near.expected


def test_noise_and_repetition_and_one_bang_are_not_unique():
    assert not find(onsets(1, 1000), onsets(2, 3000)).unique
    bar = onsets(3, 200)
    assert not find(np.tile(bar, (5, 1)), np.tile(bar, (12, 1))).unique
    part, whole = (1e-3 * onsets(seed, count) for seed, count in ((4, 1000), (5, 3000)))
    part[300], whole[2000] = 5.0, 5.0
    found = find(part, whole)
    assert found.ratio > 2.0 and found.events < 2.0 and not found.unique


def test_silence_and_what_is_too_short_is_nowhere():
    assert find(np.zeros((1000, 3), np.float32), onsets(1, 3000)) is None
    assert find(onsets(1, 300), onsets(1, 3000)) is None
