"""Clocks, timecode and audio, and a linear correction of a camera's timestamps.

Timestamps are int nanoseconds of the clock that the record names.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from panoptic_ros.domain.checks import ShapeChecks, check_stamp
from panoptic_ros.errors import ClockError, DataError, shown

Array = np.ndarray
LOWEST_RATE, HIGHEST_RATE = 1000, 400_000  # Hz, limits of audio sample rates
MOST_SAMPLES = 2**53  # a float has no fractions beyond


@dataclass(frozen=True, slots=True)
class FrameRate:
    """Timecode rate: labels count `nominal` frames per second, real time runs at `exact`.

    Raises:
        ClockError: for a rate that timecode does not define.
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
    """Timecode label HH:MM:SS:FF of SMPTE 12M.

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
        """Return the number of frames since 00:00:00:00."""
        minutes = 60 * self.hours + self.minutes
        count = (60 * minutes + self.seconds) * self.rate.nominal + self.frames
        return count - 2 * (minutes - minutes // 10) if self.rate.drop_frame else count

    @classmethod
    def from_frame_count(cls, count: int, rate: FrameRate) -> Timecode:
        """Return the label of the count-th frame of the day; counts wrap at midnight."""
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
    """Consecutive audio samples of all channels of a device.

    Args:
        stamp_ns: Timestamp of the first sample, on the device's clock.
        first_sample: Index of the first sample since the device started, so that gaps are visible. One sample
            holds one value per channel.
        sample_rate: Hz.
        samples: (N, C) float32 in -1..1; (N,) is one channel.
        clocks: Clock name per channel, whose timecode the channel carries; "" = none. Empty tuple: unknown.
            The device's own name: timecode of the device's own clock.
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
        samples = ShapeChecks(self).store("samples", np.float32, "N C")
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
        """Return the timestamp after the last sample, from the sample rate."""
        return self.stamp_ns + len(self.samples) * 1_000_000_000 // self.sample_rate


@dataclass(frozen=True, slots=True)
class TimecodeReading:
    """One timecode word decoded from audio.

    Args:
        stamp_ns: Start of the word (first edge of bit 0), on the device's clock.
        start_sample: The same in samples since the device started, fractional.
        std_samples: Standard deviation of start_sample.
        reverse: The tape ran backwards; the first edge of bit 0 then lies at the word's end.
        user_bits: 32 bits.
        clock: Name of the clock whose timecode it is; "" = the master's.
        sample_rate: Hz, as the device states; 0: unknown.
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
    """Linear model from a device's clock to the master clock.

    master = device + offset_ns + residual_ns + drift * (device - reference_ns)

    Args:
        device: Name of a camera, or of the clock or device that stamps its frames.
        reference_ns: Device time at which the offset holds.
        offset_ns: Offset at the reference, whole ns, because timestamps since 1970 have more digits than a
            float. A float is split into its whole part and the rest.
        drift: Dimensionless, 1e-6 = 1 ppm.
        covariance: (2, 2) of (offset in s, drift).
        residual_ns: Rest of the offset; whole ns of it are moved to offset_ns.
        from_ns, until_ns: Device times of the first and the last observation behind the line. After the last
            one the line is extrapolated (holdover).
        wander: Uncertainty in s that each second of holdover adds, from the crystal (1e-7 is usual).
        segment: Counts the lines of a device; a new one begins at a jump of the clock.
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
        covariance = ShapeChecks(self).store("covariance", np.float64, "2 2")
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
        """Return the master time of a device time, and its standard deviation, both in ns."""
        since = int(stamp_ns) - self.reference_ns
        master = int(stamp_ns) + self.offset_ns + round(self.residual_ns + self.drift * since)
        return master, 1e9 * self._deviation(since * 1e-9, int(stamp_ns))

    def _deviation(self, since: float, stamp_ns: int) -> float:
        """Return the standard deviation, s: that of the line, and the crystal's wander in holdover."""
        line = np.array([1.0, since]) @ self.covariance @ np.array([1.0, since])
        beyond = 1e-9 * max(0, stamp_ns - self.until_ns, self.from_ns - stamp_ns)
        return float(np.sqrt(max(0.0, float(line)) + (self.wander * beyond) ** 2))


@dataclass(frozen=True, slots=True)
class StampLine:
    """Linear correction that is added to timestamps: offset_ns + drift (stamp - reference_ns).

    Args:
        drift: Dimensionless, 1e-6 = 1 ppm.
    """

    reference_ns: int
    offset_ns: int
    drift: float = 0.0

    @classmethod
    def from_words(cls, words: Mapping[str, Any]) -> StampLine:
        """Return the line for plain values, as `words` returns them.

        Raises:
            DataError: if values are missing or are not numbers.
        """
        try:
            return cls(int(words["reference_ns"]), int(words["offset_ns"]), float(words["drift"]))
        except (KeyError, TypeError, ValueError):
            raise DataError(f"{shown(words)} is not a correction of stamps") from None

    def words(self) -> dict[str, Any]:
        """Return plain values that a file can hold."""
        return asdict(self)

    def corrected(self, stamp_ns: int) -> int:
        """Return the corrected timestamp, ns; it may be negative."""
        return stamp_ns + self.offset_ns + round(self.drift * (stamp_ns - self.reference_ns))
