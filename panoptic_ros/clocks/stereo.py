"""Align two timecodes on the channels of one recording, with the sample index as their common axis.

This is how Joo et al. (2017, 3.3) align the clock of one camera system with that of another. No computer
timestamps are involved, and the recorder's own rate cancels. The tape speed with its wow and flutter cancels
too. A word of one timecode is compared with the words of the other just before and after it, instead of the
recorder's samples. This also identifies frame rates. A word does not state whether 30 labels take 1 s or
1.001 s, and a tape with varying speed reveals it late. The number of words of one timecode per second of the
other reveals it directly.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np

from panoptic_ros.clocks.line import fit_line
from panoptic_ros.clocks.timeline import SECOND, day_length_ns, day_ns
from panoptic_ros.domain import ClockModel, FrameRate, Timecode, TimecodeReading
from panoptic_ros.errors import ClockError

Array = np.ndarray
LEAST_READINGS = 3
WIDEST_GAP = 1.5  # words of the master timecode across which its time is interpolated
OTHER_RATE = 2e-4  # drift penalty of a frame rate other than that of the last word; rates differ by 1e-3


def align_timecodes(
    master: Sequence[TimecodeReading], other: Sequence[TimecodeReading], device: str
) -> ClockModel:
    """Return the model that converts times of the other timecode (ns since midnight) to master times.

    Args:
        master, other: readings of the two channels, in recording order.
        device: name of the clock behind the other timecode, for the model.

    Raises:
        ClockError: a channel has too few readings, or the two do not overlap.
    """
    from scipy.interpolate import CubicSpline  # imported here: it loads slowly, and most runs do not need it

    for name, readings in (("master", master), (device, other)):
        if len(readings) < LEAST_READINGS:
            raise ClockError(f"{len(readings)} timecode words of {name} are too few to align two clocks")
    started, at = (np.array([r.start_sample for r in readings]) for readings in (master, other))
    if _between(at, started).sum() < LEAST_READINGS:
        raise ClockError(f"the timecodes of master and {device} are not in the recording at the same time")
    masters, others = _at_likely_rates(master, other)
    started, at = (np.array([r.start_sample for r in readings]) for readings in (masters, others))
    times, inside = _unwrapped(masters), _between(at, started)
    own_times = _unwrapped(others)
    base, reference = times[0], own_times[len(own_times) // 2]
    of_master = CubicSpline(started, [(time - base) / SECOND for time in times])
    own = np.array([(time - reference) / SECOND for time in own_times])[inside]
    difference = of_master(at[inside]) - own  # master minus other, relative to base - reference
    of_masters = np.median([r.std_samples for r in masters])
    stds = np.hypot(np.array([r.std_samples for r in others])[inside], of_masters)
    found = fit_line(own, difference, stds * float(of_master(at[inside], 1).mean()))
    few = max(1.0, len(own) / len(masters))  # words with the same neighbours are not independent
    covariance = found.covariance * few
    return ClockModel(
        device,
        reference,
        base - reference,
        found.slope,
        covariance,
        SECOND * found.offset,
        own_times[0],
        own_times[-1],
    )


def _between(at: Array, started: Array) -> Array:
    """Return which samples (N,) lie between two consecutive words (M,)."""
    after = np.searchsorted(started, at)
    inside = (after > 0) & (after < len(started))
    gaps = np.diff(started)[np.clip(after - 1, 0, len(started) - 2)]
    near: Array = inside & (gaps < WIDEST_GAP * np.median(np.diff(started)))
    return near


def _at_likely_rates(
    master: Sequence[TimecodeReading], other: Sequence[TimecodeReading]
) -> tuple[list[TimecodeReading], list[TimecodeReading]]:
    """Return the readings of both at the frame rates for which the two clocks agree best.

    If that is ambiguous, the rates of the last words are kept.
    """
    ratio = _frame_ratio(master, other)

    def unlikely(rates: tuple[FrameRate, FrameRate]) -> float:
        changed = (rates[0] != master[-1].timecode.rate) + (rates[1] != other[-1].timecode.rate)
        return abs(ratio * float(rates[1].exact / rates[0].exact) - 1.0) + OTHER_RATE * changed

    rates = [_rates_of(readings[-1].timecode.rate) for readings in (master, other)]
    pairs = [(a, b) for a in rates[0] for b in rates[1]]
    of_master, of_other = min(pairs, key=unlikely)
    return list(_with_rate(master, of_master)), list(_with_rate(other, of_other))


def _frame_ratio(master: Sequence[TimecodeReading], other: Sequence[TimecodeReading]) -> float:
    """Return the ratio of master frames to frames of the other timecode, at equal tape speed."""
    both = (master, other)
    started, at = (np.array([r.start_sample for r in readings]) for readings in both)
    frames, own = (np.array([float(r.timecode.frame_count) for r in readings]) for readings in both)
    inside = _between(at, started)
    steps = np.diff(np.interp(at, started, frames)) / np.diff(own)
    return float(np.median(steps[inside[1:] & inside[:-1]]))


def _rates_of(rate: FrameRate) -> list[FrameRate]:
    """Return the rates that have the same labels as a given rate."""
    if rate.nominal == 25 or rate.drop_frame:
        return [rate]
    return [FrameRate(rate.nominal, Fraction(1000 * rate.nominal, divisor)) for divisor in (1000, 1001)]


def _with_rate(readings: Sequence[TimecodeReading], rate: FrameRate) -> Iterator[TimecodeReading]:
    """Yield the readings with their labels at a given rate; readings with other labels are dropped."""
    for reading in readings:
        label = reading.timecode
        if (label.rate.nominal, label.rate.drop_frame) == (rate.nominal, rate.drop_frame):
            fields = label.hours, label.minutes, label.seconds, label.frames
            yield replace(reading, timecode=Timecode(*fields, rate))


def _unwrapped(readings: Sequence[TimecodeReading]) -> list[int]:
    """Return times in ns that continue over midnight."""
    times: list[int] = []
    for reading in readings:
        time, day = day_ns(reading.timecode), day_length_ns(reading.timecode)
        if times and time < times[-1]:
            time += day * -((time - times[-1]) // day)
        times.append(time)
    return times
