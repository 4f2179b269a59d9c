"""The meaning of the lag, by stamps alone."""

from types import SimpleNamespace

import numpy as np
import pytest

from panoptic_ros.refinement.lag import LagSchedule


def results(stamps, newest, lag):
    """(index of the set, index of the last set used, instant) for all that are due while sets come, ns."""
    clock, waiting, given = LagSchedule(lag), [], []
    for last, (stamp, new) in enumerate(zip(stamps, newest)):
        item = SimpleNamespace(stamp_ns=int(stamp), newest_ns=int(new), index=last)
        clock.take(item)
        waiting.append(item)
        while waiting and clock.is_due(waiting[0]):
            first = waiting.pop(0)
            given.append((first.index, last, clock.instant_ns(first)))
    return given


@pytest.mark.parametrize("rate", [25.0, 29.97, 60.0])
@pytest.mark.parametrize(("frames", "later"), [(0, 0), (0.5, 0), (1, 1), (1.6, 1), (3, 3)])
def test_synchronous_sets_keep_their_instants(rate, frames, later):
    stamps = np.rint(1e9 * np.arange(20) / rate)
    for index, last, instant in results(stamps, stamps, frames / rate)[2:]:
        assert last == index + later and instant == stamps[index]


@pytest.mark.parametrize("frames", [0, 0.25, 0.5, 1, 2, 3.5])
def test_no_view_is_later_than_the_lag_allows_and_results_are_in_order(frames):
    rng, period = np.random.default_rng(0), 1e9 / 30
    stamps = np.rint(1e9 + period * np.arange(200))
    newest = stamps + np.rint(0.4 * period + rng.normal(0, 3e5, 200))
    given = results(stamps, newest, frames / 30)
    instants = np.array([instant for _, _, instant in given])
    assert (np.diff(instants) > 0).all() and [index for index, _, _ in given] == list(range(len(given)))
    for index, last, instant in given[2:]:
        assert newest[last] <= instant + frames * period + 0.1 * period + 1
        assert stamps[index] <= instant <= newest[index]
        if frames in (0.5, 2, 3.5):
            assert instant == stamps[index]


def test_a_gap_delays_nothing_for_ever():
    stamps = 1e9 * np.concatenate([np.arange(10), np.arange(40, 50)]) / 30
    given = results(np.rint(stamps), np.rint(stamps), 0.1)
    assert [index for index, _, _ in given] == list(range(len(given))) and len(given) >= 16
