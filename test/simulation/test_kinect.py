"""Noise of depth sensors: as it is stated."""

import numpy as np
import pytest

from panoptic_ros.simulation.kinect import kinect_like


def test_noise_steps_holes_and_edges_are_as_stated():
    exact = np.full((200, 200), 2.0, np.float32)
    exact[:, 100:] = 4.0
    found = kinect_like(exact, np.random.default_rng(1))
    for columns, depth in ((slice(0, 98), 2.0), (slice(102, 200), 4.0)):
        flat = found[:, columns]
        assert (flat == 0.0).mean() == pytest.approx(0.02, abs=0.004)
        known = flat[flat > 0.0].astype(float)
        assert (known - depth).std() == pytest.approx(0.0015 * (depth / 2.0) ** 2, rel=0.1)
        assert np.abs(1e3 * known - np.round(1e3 * known)).max() < 1e-3
    edge = found[:, 99:101]
    assert (edge == 0.0).mean() == pytest.approx(0.5, abs=0.08)
    known = edge[edge > 0.0]
    mixed = (known > 2.05) & (known < 3.95)  # with the other side, which is a third of what is near
    assert mixed.mean() == pytest.approx(0.1, abs=0.06)
    assert np.array_equal(found, kinect_like(exact, np.random.default_rng(1)))
    assert (kinect_like(np.zeros((5, 5), np.float32), np.random.default_rng(1)) == 0.0).all()
