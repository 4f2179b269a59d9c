"""Fit a clock model to points of device time and master time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from panoptic_ros.clocks.envelope import fit_lower_line
from panoptic_ros.clocks.line import Line, fit_line
from panoptic_ros.domain import ClockModel

Array = np.ndarray
SECOND = 1_000_000_000
SKEW_POINTS = 150  # minimum number of points for the test of one-way delays
SKEW_RATIO = 2.0  # ratio of the late tail to the early tail above which timestamps are one-way
PRIOR_DRIFT = 1e-6  # standard deviation of the change of a crystal's drift at a clock jump


@dataclass(frozen=True, slots=True)
class ClockReading:
    """Reading as a pair of times, with its sample index on the device.

    Args:
        device_ns: device time.
        master_ns: master time.
        sample: fractional sample index.
        noise_s: standard deviation stated by the reading, s.
    """

    device_ns: int
    master_ns: int
    sample: float
    noise_s: float


@dataclass(frozen=True)
class ClockEstimate:
    """Clock model, whether its timestamps are one-way delayed, and the scatter of the points about it (s)."""

    model: ClockModel
    one_way: bool
    noise: float


def estimate(
    device: str,
    points: Sequence[ClockReading],
    stamps: str,
    one_way: bool,
    before: ClockModel | None,
    least_noise: float,
) -> ClockEstimate:
    """Fit the line through the points, with the middle point as its reference.

    Args:
        stamps: "auto", "symmetric" or "one-way", see `ClocksConfig`.
        one_way: result of "auto" so far.
        before: model of other points. Its drift is the prior if these points span too little time.
        least_noise: minimum standard deviation of a point, s.
    """
    reference = points[len(points) // 2]
    base = reference.master_ns - reference.device_ns
    x = np.array([(point.device_ns - reference.device_ns) / SECOND for point in points])
    y = np.array([(point.master_ns - point.device_ns - base) / SECOND for point in points])
    noises = np.array([max(point.noise_s, least_noise) for point in points])
    noises[noises == 0.0] = noises.max()  # readings from before the sample duration was known
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
    return ClockEstimate(model, one_way, noise)


def _late_more_than_early(lateness: Array) -> bool:
    if len(lateness) < SKEW_POINTS:
        return False
    low, middle, high = np.quantile(lateness, [0.05, 0.5, 0.95])
    return bool(high - middle > SKEW_RATIO * (middle - low) and high - middle > 2e-5)


def _with_drift(line: Line, before: ClockModel) -> Line:
    """Update the line with the drift of an earlier model (a Kalman update)."""
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
