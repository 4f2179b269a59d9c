"""The smoother of edges against a Gaussian process solved at once."""

from __future__ import annotations

import numpy as np
import pytest

from panoptic_ros.timecode.word.smoothing import BANDWIDTHS, Motion, likelihoods, smooth

Array = np.ndarray
BANDWIDTH = 0.3


def _step(h: float) -> Array:
    return np.array([[1.0, h, h * h / 2], [0.0, 1.0, h], [0.0, 0.0, 1.0]])


def _wandering(h: float) -> Array:
    a, b, c = h**4 / 8, h**3 / 6, h * h / 2
    return np.array([[h**5 / 20, a, b], [a, h**3 / 3, c], [b, c, h]])


def test_edges_are_those_of_the_process_given_all_measurements() -> None:
    rng = np.random.default_rng(0)
    cells = np.cumsum(rng.choice([0.5, 1.0], 60)) - 40.0
    noise = rng.uniform(0.5, 2.0, 60)
    measured = 900.0 + 20.0 * cells + 3.0 * rng.normal(size=60)
    root = rng.normal(size=(3, 3))
    spread = root @ root.T
    before = Motion(cells[0] - 0.5, 90.0, 20.0, 0.1, spread[np.triu_indices(3)])
    found = smooth(cells, measured, noise, before, BANDWIDTH)

    density = BANDWIDTH**6 * (cells[-1] - cells[0]) / (1.0 / noise).sum()
    state, at, means, spreads = np.array(before[1:4]), before.cell, [], []
    for cell in cells:
        state, spread = _step(cell - at) @ state, _step(cell - at) @ spread @ _step(cell - at).T
        spread = spread + density * _wandering(cell - at)
        at = cell
        means.append(state[0])
        spreads.append(spread)
    prior = np.empty((60, 60))
    for i in range(60):
        for j in range(i, 60):
            prior[i, j] = prior[j, i] = (spreads[i] @ _step(cells[j] - cells[i]).T)[0, 0]
    total, error = prior + np.diag(noise), measured - means
    scale = error @ np.linalg.solve(total, error) / 60
    np.testing.assert_allclose(found.places, means + prior @ np.linalg.solve(total, error), atol=1e-6)
    variances = np.diag(prior - prior @ np.linalg.solve(total, prior))
    np.testing.assert_allclose(found.variances, variances, rtol=1e-6)
    assert found.scale == pytest.approx(scale)
    assert found.nats == pytest.approx(-0.5 * (60 * np.log(scale) + np.linalg.slogdet(total)[1]))
    assert likelihoods(cells, measured, noise, before, np.array([BANDWIDTH]))[0] == pytest.approx(found.nats)
    assert found.end.cell == cells[-1]


@pytest.mark.parametrize("true", [0.05, 0.25])
def test_the_likely_bandwidth_is_that_of_the_motion(true: float) -> None:
    """Of motions drawn from the model, and smaller with it than with bandwidths that are far off."""
    rng, cells = np.random.default_rng(1), np.arange(-40.0, 40.5, 0.75)
    density = true**6 * 0.75
    nats = np.zeros(len(BANDWIDTHS))
    for _ in range(12):
        state, places = np.array([0.0, 20.0, 0.0]), []
        root = np.linalg.cholesky(density * _wandering(0.75))
        for _ in cells:
            places.append(state[0])
            state = _step(0.75) @ state + root @ rng.normal(size=3)
        before = Motion(-40.0, 0.0, 20.0, 0.0, np.array([9.0, 0.0, 0.0, 1.0, 0.0, 0.01]))
        measured = np.array(places) + rng.normal(size=len(cells))
        nats += likelihoods(cells, measured, np.ones(len(cells)), before, BANDWIDTHS)
    assert 0.6 < BANDWIDTHS[int(np.argmax(nats))] / true < 1.7
