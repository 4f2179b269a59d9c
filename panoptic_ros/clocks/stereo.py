"""Two timecodes on the channels of one recording: they share the sample index as their axis.

This is how Joo et al. (2017, 3.3) align the clock of one camera system with that of another: no stamp of
any computer is involved, and the recorder's own rate cancels. So does the speed of a tape, with its wow and
flutter: a word of one timecode is held against the words of the other just before and after it, not against
the recorder's samples. That also tells rates: a word does not say whether 30 labels last a second or 1.001 s,
and a tape that swings tells it late, but the number of words of one timecode per second of the other does.
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
WIDEST_GAP = 1.5  # words of the master, between which its time is known
OTHER_RATE = 2e-4  # of drift that is rather believed than another rate of frames; rates differ by 1e-3


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
    from scipy.interpolate import CubicSpline  # takes long to load, which most runs do not need

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
    difference = of_master(at[inside]) - own  # master less other, about base - reference
    of_masters = np.median([r.std_samples for r in masters])
    stds = np.hypot(np.array([r.std_samples for r in others])[inside], of_masters)
    found = fit_line(own, difference, stds * float(of_master(at[inside], 1).mean()))
    few = max(1.0, len(own) / len(masters))  # words are not independent where they have the same neighbours
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
    """Which samples (N,) are between two words (M,) that follow each other."""
    after = np.searchsorted(started, at)
    inside = (after > 0) & (after < len(started))
    gaps = np.diff(started)[np.clip(after - 1, 0, len(started) - 2)]
    near: Array = inside & (gaps < WIDEST_GAP * np.median(np.diff(started)))
    return near


def _at_likely_rates(
    master: Sequence[TimecodeReading], other: Sequence[TimecodeReading]
) -> tuple[list[TimecodeReading], list[TimecodeReading]]:
    """The readings of both at the rates at which the clocks agree best, in doubt those of the last words."""
    ratio = _frame_ratio(master, other)

    def unlikely(rates: tuple[FrameRate, FrameRate]) -> float:
        changed = (rates[0] != master[-1].timecode.rate) + (rates[1] != other[-1].timecode.rate)
        return abs(ratio * float(rates[1].exact / rates[0].exact) - 1.0) + OTHER_RATE * changed

    rates = [_rates_of(readings[-1].timecode.rate) for readings in (master, other)]
    pairs = [(a, b) for a in rates[0] for b in rates[1]]
    of_master, of_other = min(pairs, key=unlikely)
    return list(_with_rate(master, of_master)), list(_with_rate(other, of_other))


def _frame_ratio(master: Sequence[TimecodeReading], other: Sequence[TimecodeReading]) -> float:
    """Frames of the master to those of the other, at the same speed of the tape."""
    both = (master, other)
    started, at = (np.array([r.start_sample for r in readings]) for readings in both)
    frames, own = (np.array([float(r.timecode.frame_count) for r in readings]) for readings in both)
    inside = _between(at, started)
    steps = np.diff(np.interp(at, started, frames)) / np.diff(own)
    return float(np.median(steps[inside[1:] & inside[:-1]]))


def _rates_of(rate: FrameRate) -> list[FrameRate]:
    """The rates that have the labels of one."""
    if rate.nominal == 25 or rate.drop_frame:
        return [rate]
    return [FrameRate(rate.nominal, Fraction(1000 * rate.nominal, divisor)) for divisor in (1000, 1001)]


def _with_rate(readings: Sequence[TimecodeReading], rate: FrameRate) -> Iterator[TimecodeReading]:
    """The readings with the labels of a rate; those that have other labels are left out."""
    for reading in readings:
        label = reading.timecode
        if (label.rate.nominal, label.rate.drop_frame) == (rate.nominal, rate.drop_frame):
            fields = label.hours, label.minutes, label.seconds, label.frames
            yield replace(reading, timecode=Timecode(*fields, rate))


def _unwrapped(readings: Sequence[TimecodeReading]) -> list[int]:
    """Times in ns, counted on over midnight."""
    times: list[int] = []
    for reading in readings:
        time, day = day_ns(reading.timecode), day_length_ns(reading.timecode)
        if times and time < times[-1]:
            time += day * -((time - times[-1]) // day)
        times.append(time)
    return times
