"""The clock of a camera from the stamps of its frames: period, drops, jitter, and the line under them.

Frames are exposed at even times, and stamps of the host are late by a transport delay. The x axis is the
count of frames, dropped ones included. The line under the stamps (`envelope`) is the clock of the camera, up
to a constant that stamps cannot show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from panoptic_ros.clocks.envelope import fit_lower_line
from panoptic_ros.clocks.line import Line, fit_line
from panoptic_ros.errors import DataError

Array = np.ndarray
LEAST_FRAMES = 8
FOLLOW = 0.1  # of the error of a frame, by which the expected time of the next one is moved
LATE_RATIO = 2.0


@dataclass(frozen=True, eq=False)
class FrameTiming:
    """What the stamps of a camera tell.

    Args:
        rate_hz, rate_std_hz: frames per second of the clock that stamps.
        counts: (N,) number of every frame on the camera's even grid; dropped ones are left out.
        errors_s: (N,) stamp minus the line.
        interval_std_s: of the steps between stamps, without drops.
        jitter_s: robust standard deviation about the line through the stamps.
        lost: frames that are missing between others; gaps: places where frames are missing.
        not_later: stamps that are not later than the one before; all else is without them.
        one_way: whether stamps are late more than early, so that the line lies under them.
    """

    reference_ns: int
    rate_hz: float
    rate_std_hz: float
    counts: Array
    errors_s: Array
    interval_std_s: float
    jitter_s: float
    lost: int
    gaps: int
    not_later: int
    one_way: bool


def measure_frames(stamps_ns: Sequence[int], numbers: Sequence[int] | None = None) -> FrameTiming:
    """Measure the frames of one camera.

    Args:
        stamps_ns: in the order of arrival.
        numbers: of the frames, if the device counts those that it drops; None: found from the stamps.

    Raises:
        DataError: for fewer than 8 frames with increasing stamps.
    """
    kept = [0] if len(stamps_ns) else []
    for k in range(1, len(stamps_ns)):
        if stamps_ns[k] > stamps_ns[kept[-1]]:
            kept.append(k)
    if len(kept) < LEAST_FRAMES:
        raise DataError(f"{len(kept)} frames with increasing stamps are too few to measure a clock")
    reference = int(stamps_ns[kept[0]])
    times = np.array([(int(stamps_ns[k]) - reference) * 1e-9 for k in kept])
    counts = _count(times)
    if numbers is not None:
        given = np.array([numbers[k] for k in kept]) - numbers[kept[0]]
        counts = given if (np.diff(given) > 0).all() and given[-1] > len(given) - 1 else counts
    line, one_way = _line(counts, times)
    steps = np.diff(counts)
    return FrameTiming(
        reference_ns=reference,
        rate_hz=1.0 / line.slope,
        rate_std_hz=float(np.sqrt(max(line.covariance[1, 1], 0.0))) / line.slope**2,
        counts=counts,
        errors_s=times - line.offset - line.slope * counts,
        interval_std_s=float(np.std(np.diff(times)[steps == 1])) if (steps == 1).any() else float("nan"),
        jitter_s=_spread(times - line.offset - line.slope * counts),
        lost=int((steps - 1).sum()),
        gaps=int((steps > 1).sum()),
        not_later=len(stamps_ns) - len(kept),
        one_way=one_way,
    )


def _count(times: Array) -> Array:
    """Number of every frame: the next one is expected a period after where the last one should have been."""
    period = _usual_step(np.diff(times))
    counts = [0]
    expected = float(times[0])
    for time in times[1:]:
        step = round((time - expected) / period)
        if step < 1 and len(counts) > 1 and counts[-1] - counts[-2] > 1:  # the last one was late, not dropped
            counts[-1] -= 1
            expected -= period
        step = max(1, round((time - expected) / period))
        expected += step * period
        error = float(time) - expected
        if abs(error) > 0.75 * period:  # several late frames in a row: begin anew from here
            expected = float(time)
        else:
            expected += FOLLOW * error
        counts.append(counts[-1] + step)
    return np.array(counts)


def _usual_step(steps: Array) -> float:
    """The period: the mean of the steps that are near the median, which drops do not move."""
    middle = float(np.median(steps))
    return float(steps[np.abs(steps - middle) < 0.4 * middle].mean())


def _line(counts: Array, times: Array) -> tuple[Line, bool]:
    """The line of stamps over counts, and whether it lies under them as they are late more than early."""
    x = counts.astype(float)
    line = fit_line(x, times, np.full(len(x), 1e-9))
    error = times - line.offset - line.slope * x
    low, middle, high = np.quantile(error, [0.05, 0.5, 0.95])
    if len(x) >= 100 and high - middle > LATE_RATIO * (middle - low) and high - middle > 2e-5:
        return fit_lower_line(x, times), True
    return line, False


def _spread(errors: Array) -> float:
    return 1.4826 * float(np.median(np.abs(errors - np.median(errors))))
