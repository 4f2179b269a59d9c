"""What is fed to the graph: every set in turn, forth and back, each view at its own time."""

import numpy as np
import pytest

from panoptic_ros.errors import UsageError
from panoptic_ros.study.live import graph_feed
from panoptic_ros.study.live.graph_feed import simulated_feed


@pytest.fixture
def feed(monkeypatch):
    monkeypatch.setattr(graph_feed, "INSTANTS", 4)
    return simulated_feed("noisy-8p5v", 2, 3, 25.0)


def test_sets_are_played_forth_and_back(feed):
    assert [feed.number_of_set(k) for k in range(9)] == [0, 1, 2, 3, 2, 1, 0, 1, 2]
    assert feed.period_ns == 40_000_000


def test_views_come_in_order_of_their_stamps_and_not_all_at_once(feed):
    offsets, views = zip(*feed.views(1))
    assert {view.camera for view in views} == set(feed.rig.names) and len(views) == 3
    assert offsets[0] == 0 and np.all(np.diff(offsets) > 0) and offsets[-1] <= 2e9 * graph_feed.PHASE_S
    assert np.array_equal(np.diff(offsets), np.diff([view.stamp_ns for view in views]))


def test_nobody_and_rates_too_high_for_the_spread_are_refused(monkeypatch):
    with pytest.raises(UsageError, match="0 people"):
        simulated_feed("noisy-8p5v", 0, None, 30.0)
    monkeypatch.setattr(graph_feed, "PHASE_S", 0.016)
    with pytest.raises(UsageError, match="lower --rate"):
        simulated_feed("noisy-8p5v", 1, None, 30.0)
