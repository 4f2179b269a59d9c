"""Two timecodes on the channels of one recording: they share the sample index as their axis.

This is how Joo et al. (2017, 3.3) align the clock of one camera system with that of another: no stamp of
any computer is involved, and the recorder's own rate cancels.
"""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from panoptic_ros.clocks.line import fit_line
from panoptic_ros.clocks.timeline import SECOND, day_length_ns, day_ns
from panoptic_ros.domain import ClockModel, TimecodeReading
from panoptic_ros.errors import ClockError

Array = np.ndarray
LEAST_READINGS = 3


def align_timecodes(
    master: Sequence[TimecodeReading], other: Sequence[TimecodeReading], device: str
) -> ClockModel:
    """The model that turns times of the other timecode (ns since its midnight) into times of the master.

    Args:
        master, other: readings of the two channels, in the order of the recording.
        device: name of the clock behind the other timecode, for the model.

    Raises:
        ClockError: if a channel has too few readings, or the two do not overlap.
    """
    for name, readings in (("master", master), (device, other)):
        if len(readings) < LEAST_READINGS:
            raise ClockError(f"{len(readings)} timecode words of {name} are too few to align two clocks")
    samples = [np.array([r.start_sample for r in readings]) for readings in (master, other)]
    if max(s[0] for s in samples) >= min(s[-1] for s in samples):
        raise ClockError(f"the timecodes of master and {device} are not in the recording at the same time")
    times = [_unwrapped(readings) for readings in (master, other)]
    stds = [np.array([r.std_samples for r in readings]) for readings in (master, other)]
    origin = float(samples[1].mean())
    period = (times[0][-1] - times[0][0]) / SECOND / (samples[0][-1] - samples[0][0])
    base = times[0][0]
    x = (samples[0] - origin) * period
    y = np.array([(t - base) / SECOND for t in times[0]]) - x
    line = fit_line(x, y, stds[0] * period)  # master time of a sample
    at = (samples[1] - origin) * period
    reference = times[1][len(times[1]) // 2]
    own = np.array([(t - reference) / SECOND for t in times[1]])
    difference = line.offset + (1.0 + line.slope) * at - own  # master less other, about base - reference
    found = fit_line(own, difference, stds[1] * period)
    return ClockModel(
        device, reference, base - reference, found.slope, found.covariance + line.covariance,
        SECOND * found.offset, times[1][0], times[1][-1],
    )  # fmt: skip


def _unwrapped(readings: Sequence[TimecodeReading]) -> list[int]:
    """Times in ns, counted on over midnight."""
    times: list[int] = []
    for reading in readings:
        time, day = day_ns(reading.timecode), day_length_ns(reading.timecode)
        if times and time < times[-1]:
            time += day * -((time - times[-1]) // day)
        times.append(time)
    return times
