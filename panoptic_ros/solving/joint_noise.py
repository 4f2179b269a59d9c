"""Noise of 2D joints, learnt from the residuals of trajectories."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from panoptic_ros.geometry.medians import finite_median

Array = np.ndarray
SCORE_BINS = 5
LEAST_COUNT = 60  # minimum number of residuals for a separate noise factor of a group
RAYLEIGH_MEDIAN = 1.17741  # median length of a 2D residual with standard deviation 1 per axis
LEAST_NOISE = 2e-5  # on the normalised image plane: 0.03 px at a focal length of 1500 px


class JointNoiseModel:
    """Standard deviations of 2D joints on the normalised image plane, by score, camera and joint.

    All values come from medians of residuals, so outliers hardly affect them.

    Args:
        cameras, joints, scores: (N,) of the observations.
        start: standard deviation before anything is learnt.
        factors: factors by score bin, camera and joint that were learnt before.
    """

    def __init__(
        self, cameras: Array, joints: Array, scores: Array, start: float, factors: list[Array] | None = None
    ):
        self._groups = (np.minimum((scores * SCORE_BINS).astype(np.int64), SCORE_BINS - 1), cameras, joints)
        self._start = start
        self.factors = factors or [np.ones(int(group.max(initial=0)) + 1) for group in self._groups]

    @cached_property
    def _orders(self) -> list[Array]:
        return [np.argsort(group, kind="stable") for group in self._groups]

    def sigmas(self) -> Array:
        """Return the standard deviations (N,) of the observations."""
        value = np.full(len(self._groups[0]), self._start)
        for group, factors in zip(self._groups, self.factors):
            value *= factors[group]
        sigmas: Array = np.maximum(value, LEAST_NOISE)
        return sigmas

    def learn(self, ratios: Array, usable: Array | None = None) -> None:
        """Update the factors from residuals (N,) in units of `sigmas`, corrected for leverage.

        Args:
            usable: (N,) True for residuals that count; None = all.
        """
        left = ratios.copy()
        counted = np.ones(len(left), bool) if usable is None else usable
        for group, order, factors in zip(self._groups, self._orders, self.factors):
            own = order[counted[order]]
            ends = np.searchsorted(group[own], np.arange(len(factors) + 1))
            values, change = left[own], np.ones(len(factors))
            for k in np.flatnonzero(np.diff(ends) >= LEAST_COUNT):
                change[k] = max(finite_median(values[ends[k] : ends[k + 1]]) / RAYLEIGH_MEDIAN, 1e-3)
            factors *= change
            left /= change[group]
