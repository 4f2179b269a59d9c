"""Robust weights for large residuals, shared by all estimators: the likelihood of a Cauchy distribution."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from panoptic_ros.kernels import inlined

TIE_BREAK = 1e-6  # share of the limit


def growth(squared: Any, scale: float) -> Any:
    """Return the factor by which a residual enlarges its measurement's variance: 1 / Cauchy weight.

    Args:
        squared: Squared residual divided by the variance; a number or an array.
        scale: Scale of the weight, in standard deviations.
    """
    return 1.0 + squared * (1.0 / (scale * scale))  # compilers move the constant part out of loops


noise_growth = inlined(growth)  # for kernels


@inlined
def relative_growth(squared, scale):
    """Return `growth` relative to that of a residual of one standard deviation: covariances stay unbiased."""
    return noise_growth(squared, scale) / noise_growth(1.0, scale)


@cache
def covariance_correction(scale: float) -> float:
    """Return the variance of the robust estimate of a 2D Gaussian, divided by its inverse mean weight.

    For psi(r) = r w(r^2) the variance is E[psi^2] / E[psi']^2 (Huber 1964). It is per axis here, and r^2 is
    chi-squared with two degrees of freedom.

    Args:
        scale: Scale of the weight w = 1 / `growth`, in standard deviations.
    """
    squares = np.linspace(0.0, 60.0, 6001)[1:] - 0.005
    density = 0.5 * np.exp(-0.5 * squares) * 0.01
    weight = 1.0 / growth(squares, scale)
    slope = weight + squares * np.gradient(weight, squares)  # mean over the axes of d psi / d r
    variance = (0.5 * squares * weight**2 * density).sum() / (slope * density).sum() ** 2
    return float(variance * (weight * density).sum())


@inlined
def truncated(cost, limit):
    """Return the truncated value of a cost (>= 0); beyond the limit it grows by at most a share TIE_BREAK.

    Without that slope, all places at which every view is an outlier would cost the same. The order of the
    cameras would then decide between them.
    """
    return cost if cost < limit else limit * (1.0 + TIE_BREAK * (1.0 - limit / cost))
