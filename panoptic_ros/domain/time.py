"""Clocks, timecode and audio; a line that corrects the stamps of a camera.

Stamps are int nanoseconds of the clock that the record names.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from panoptic_ros.domain.checks import Shapes, check_stamp
from panoptic_ros.errors import ClockError, DataError, shown

Array = np.ndarray
LOWEST_RATE, HIGHEST_RATE = 1000, 400_000  # Hz, of sound
MOST_SAMPLES = 2**53  # a float has no fractions beyond


@dataclass(frozen=True, slots=True)
class FrameRate:
    """A timecode rate: labels count `nominal` frames per second, real time runs at `exact`.

    Raises:
        ClockError: for a rate that timecode does not know.
    """

    nominal: int  # 24, 25 or 30
    exact: Fraction  # Hz
    drop_frame: bool = False  # only for 29.97 Hz

    def __post_init__(self) -> None:
        known = {
            (24, Fraction(24000, 1001)),
            (24, Fraction(24)),
            (25, Fraction(25)),
            (30, Fraction(30000, 1001)),
            (30, Fraction(30)),
        }
        if (self.nominal, self.exact) not in known:
            raise ClockError(f"no timecode rate: {self.nominal} labels at {float(self.exact):g} Hz")
        if self.drop_frame and self.exact != Fraction(30000, 1001):
            raise ClockError("drop-frame timecode exists at 29.97 Hz only")


@dataclass(frozen=True, slots=True)
class Timecode:
    """A label HH:MM:SS:FF of SMPTE 12M.

    Raises:
        ClockError: for labels that do not exist (out of range, or dropped in drop-frame).
    """

    hours: int
    minutes: int
    seconds: int
    frames: int
    rate: FrameRate

    def __post_init__(self) -> None:
        inside = (
            0 <= self.hours < 24
            and 0 <= self.minutes < 60
            and 0 <= self.seconds < 60
            and 0 <= self.frames < self.rate.nominal
        )
        dropped = self.rate.drop_frame and self.seconds == 0 and self.frames < 2 and self.minutes % 10 != 0
        if not inside or dropped:
            raise ClockError(f"no such timecode: {self} at {float(self.rate.exact):.5g} Hz")

    def __str__(self) -> str:
        mark = ";" if self.rate.drop_frame else ":"
        return f"{self.hours:02d}:{self.minutes:02d}:{self.seconds:02d}{mark}{self.frames:02d}"

    @property
    def frame_count(self) -> int:
        """Frames since 00:00:00:00."""
        minutes = 60 * self.hours + self.minutes
        count = (60 * minutes + self.seconds) * self.rate.nominal + self.frames
        return count - 2 * (minutes - minutes // 10) if self.rate.drop_frame else count

    @classmethod
    def from_frame_count(cls, count: int, rate: FrameRate) -> Timecode:
        """The label of the count-th frame of the day; counts wrap at midnight."""
        if rate.drop_frame:
            count %= 24 * 107892
            tens, rest = divmod(count, 17982)
            count += 18 * tens + (2 * ((rest - 2) // 1798) if rest >= 2 else 0)
        else:
            count %= 24 * 3600 * rate.nominal
        seconds, frames = divmod(count, rate.nominal)
        minutes, seconds = divmod(seconds, 60)
        hours, minutes = divmod(minutes, 60)
        return cls(hours, minutes, seconds, frames, rate)


@dataclass(frozen=True, slots=True, eq=False)
class AudioBlock:
    """Consecutive samples of a device, of all of its channels.

    Args:
        stamp_ns: instant of the first sample, on the device's clock.
        first_sample: index of the first sample since the device started; gaps are visible. A sample is an
            instant: one value of each channel.
        sample_rate: Hz.
        samples: (N, C) float32 in -1..1; (N,) is one channel.
        clocks: names of the clocks whose timecode the channels carry, one for each; "" = none. Empty: nobody
            says. A channel that is named as its device hears timecode on the device's own clock.
    """

    device: str
    stamp_ns: int
    first_sample: int
    sample_rate: int
    samples: Array
    clocks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "stamp_ns", check_stamp(self, self.stamp_ns))
        given = np.asarray(self.samples)
        object.__setattr__(self, "samples", given[:, None] if given.ndim == 1 else given)
        samples = Shapes(self).store("samples", np.float32, "N C")
        object.__setattr__(self, "clocks", tuple(self.clocks))
        if not np.isfinite(samples).all():
            raise DataError(f"audio of {self.device} has samples that are not finite")
        if not LOWEST_RATE <= self.sample_rate <= HIGHEST_RATE:
            raise DataError(f"audio of {self.device} has a sample rate of {self.sample_rate} Hz")
        if not samples.shape[1]:
            raise DataError(f"audio of {self.device} has no channels")
        if self.clocks and len(self.clocks) != samples.shape[1]:
            raise DataError(
                f"audio of {self.device} has {samples.shape[1]} channels, but {len(self.clocks)} clocks are "
                f"named: {', '.join(self.clocks)}"
            )

    @property
    def end_ns(self) -> int:
        """Where the next sample is, by the sample rate."""
        return self.stamp_ns + len(self.samples) * 1_000_000_000 // self.sample_rate


@dataclass(frozen=True, slots=True)
class TimecodeReading:
    """One timecode word that was heard.

    Args:
        stamp_ns: start of the word (first edge of bit 0), on the device's clock.
        start_sample: the same in samples since the device started, fractional.
        std_samples: standard deviation of start_sample.
        reverse: the tape ran backwards; the first edge of bit 0 then lies at the word's end.
        user_bits: 32 bits.
        clock: whose timecode it is; "": that of the master, which nobody needs to name.
        sample_rate: Hz, as the device says; 0: not known.
    """

    device: str
    stamp_ns: int
    timecode: Timecode
    start_sample: float
    std_samples: float
    reverse: bool = False
    user_bits: int = 0
    clock: str = ""
    sample_rate: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "stamp_ns", check_stamp(self, self.stamp_ns))
        if not (abs(self.start_sample) < MOST_SAMPLES and 0.0 <= self.std_samples < MOST_SAMPLES):
            raise DataError(
                f"a timecode of {self.device} begins at sample {self.start_sample:.6g} +- "
                f"{self.std_samples:.3g}"
            )
        if self.sample_rate and not LOWEST_RATE <= self.sample_rate <= HIGHEST_RATE:
            raise DataError(f"a timecode of {self.device} has a sample rate of {self.sample_rate} Hz")


@dataclass(frozen=True, slots=True, eq=False)
class ClockModel:
    """A line from a device's clock to the master clock.

    master = device + offset_ns + residual_ns + drift * (device - reference_ns)

    Args:
        device: a camera's name, or that of the clock or device that stamps its frames.
        reference_ns: device time about which the line is stated.
        offset_ns: at the reference, whole ns; stamps since 1970 need more digits than a float has. A float
            is split into whole and rest.
        drift: dimensionless, 1e-6 = 1 ppm.
        covariance: (2, 2) of (offset in s, drift).
        residual_ns: what offset_ns lacks; whole ns of it are moved there.
        from_ns, until_ns: device times of the first and the last observation behind the line. After the
            last one the line is held over.
        wander: s of uncertainty that each second of holdover adds, from the crystal (1e-7 is usual).
        segment: counts the lines of a device; a new one begins where a clock has jumped.
    """

    device: str
    reference_ns: int
    offset_ns: int
    drift: float
    covariance: Array
    residual_ns: float = 0.0
    from_ns: int = 0
    until_ns: int = 2**63 - 1
    wander: float = 0.0
    segment: int = 0

    def __post_init__(self) -> None:
        for name in ("reference_ns", "from_ns", "until_ns"):
            object.__setattr__(self, name, check_stamp(self, getattr(self, name), name))
        covariance = Shapes(self).store("covariance", np.float64, "2 2")
        numbers = [self.offset_ns, self.residual_ns, self.drift, self.wander]
        if not (np.isfinite(covariance).all() and np.isfinite(np.array(numbers, float)).all()):
            raise DataError(f"clock model of {self.device} is not finite")
        whole = round(self.offset_ns)
        rest = float(self.residual_ns + (self.offset_ns - whole))
        whole += round(rest)
        object.__setattr__(self, "residual_ns", rest - round(rest))
        object.__setattr__(self, "offset_ns", whole)
        if abs(whole) >= 2**63 or self.wander < 0.0 or (np.diag(covariance) < 0.0).any():
            raise DataError(f"clock model of {self.device} has numbers out of range")

    def master_from_device(self, stamp_ns: int) -> tuple[int, float]:
        """The master time of a device time, and its standard deviation, both in ns."""
        since = int(stamp_ns) - self.reference_ns
        master = int(stamp_ns) + self.offset_ns + round(self.residual_ns + self.drift * since)
        return master, 1e9 * self._deviation(since * 1e-9, int(stamp_ns))

    def _deviation(self, since: float, stamp_ns: int) -> float:
        """Standard deviation, s: the line's own, and the crystal's wandering outside of its observations."""
        line = np.array([1.0, since]) @ self.covariance @ np.array([1.0, since])
        beyond = 1e-9 * max(0, stamp_ns - self.until_ns, self.from_ns - stamp_ns)
        return float(np.sqrt(max(0.0, float(line)) + (self.wander * beyond) ** 2))


@dataclass(frozen=True, slots=True)
class StampLine:
    """What is added to stamps: offset_ns + drift (stamp - reference_ns).

    Args:
        drift: dimensionless, 1e-6 = 1 ppm.
    """

    reference_ns: int
    offset_ns: int
    drift: float = 0.0

    @classmethod
    def from_words(cls, words: Mapping[str, Any]) -> StampLine:
        """The line of plain words, as `words` gives them.

        Raises:
            DataError: if these are no such numbers.
        """
        try:
            return cls(int(words["reference_ns"]), int(words["offset_ns"]), float(words["drift"]))
        except (KeyError, TypeError, ValueError):
            raise DataError(f"{shown(words)} is no correction of stamps") from None

    def words(self) -> dict[str, Any]:
        """Plain words that a file can hold."""
        return asdict(self)

    def corrected(self, stamp_ns: int) -> int:
        """The corrected stamp, ns; it may lie before 0."""
        return stamp_ns + self.offset_ns + round(self.drift * (stamp_ns - self.reference_ns))
