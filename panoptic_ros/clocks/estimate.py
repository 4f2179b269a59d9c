"""From points of device and master time to a clock model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from panoptic_ros.clocks.envelope import fit_lower_line
from panoptic_ros.clocks.line import Line, fit_line
from panoptic_ros.domain import ClockModel

Array = np.ndarray
SECOND = 1_000_000_000
SKEW_POINTS = 150
SKEW_RATIO = 2.0  # tail of late stamps over that of early ones
PRIOR_DRIFT = 1e-6  # how much the rate of a crystal may differ after a jump of its count


@dataclass(frozen=True, slots=True)
class Point:
    """A reading as a pair of times, with its place in the device's count of samples.

    Args:
        noise_s: standard deviation that the reading claims.
    """

    device_ns: int
    master_ns: int
    sample: float
    noise_s: float


@dataclass(frozen=True)
class Estimate:
    """A model, whether its stamps were taken as one-way, and the scatter of points about it, s."""

    model: ClockModel
    one_way: bool
    noise: float


def estimate(
    device: str,
    points: Sequence[Point],
    stamps: str,
    one_way: bool,
    before: ClockModel | None,
    least_noise: float,
) -> Estimate:
    """The line through the points, stated about their middle.

    Args:
        stamps: "auto", "symmetric" or "one-way", see `ClocksConfig`.
        one_way: what "auto" has found so far.
        before: a model from other points; its drift helps where these points span too little time.
        least_noise: that points have at least, s.
    """
    reference = points[len(points) // 2]
    base = reference.master_ns - reference.device_ns
    x = np.array([(point.device_ns - reference.device_ns) / SECOND for point in points])
    y = np.array([(point.master_ns - point.device_ns - base) / SECOND for point in points])
    noises = np.array([max(point.noise_s, least_noise) for point in points])
    noises[noises == 0.0] = noises.max()  # of readings before the length of a sample was known
    line = fit_line(x, y, noises)
    error = y - line.offset - line.slope * x
    if stamps == "auto" and not one_way:
        one_way = _late_more_than_early(-error)
    if one_way:
        under = fit_lower_line(x, -y)
        line = Line(-under.offset, -under.slope, under.covariance, under.noise)
    if before is not None:
        line = _with_drift(line, before)
    noise = 1.4826 * float(np.median(np.abs(error - np.median(error))))
    model = ClockModel(
        device,
        reference.device_ns,
        base,
        line.slope,
        line.covariance,
        SECOND * line.offset,
        points[0].device_ns,
        points[-1].device_ns,
    )
    return Estimate(model, one_way, noise)


def _late_more_than_early(lateness: Array) -> bool:
    if len(lateness) < SKEW_POINTS:
        return False
    low, middle, high = np.quantile(lateness, [0.05, 0.5, 0.95])
    return bool(high - middle > SKEW_RATIO * (middle - low) and high - middle > 2e-5)


def _with_drift(line: Line, before: ClockModel) -> Line:
    """The line updated by what was known of the drift (a Kalman update)."""
    known = before.covariance[1, 1] + PRIOR_DRIFT**2
    own = line.covariance[1, 1]
    if own <= 0.01 * known:
        return line
    gain = line.covariance[:, 1] / (own + known)
    miss = before.drift - line.slope
    covariance = line.covariance - np.outer(gain, line.covariance[1])
    return Line(
        line.offset + float(gain[0]) * miss, line.slope + float(gain[1]) * miss, covariance, line.noise
    )
