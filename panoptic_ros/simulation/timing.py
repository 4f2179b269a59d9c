"""Exposure times of cameras, and their assignment to detection sets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from panoptic_ros.simulation.generators import Generator

Array = np.ndarray
EPOCH_NS = 1_000_000_000  # timestamp of t = 0
# timestamp of t = 0 on the first camera's clock, where each camera has its own clock
OWN_EPOCH_NS = 60_000_000_000


@dataclass(frozen=True)
class OwnClocks:
    """Own clocks of the cameras, which stamp frames and sound and run behind the first camera's clock.

    Args:
        behind: Range of the clock offsets behind the first camera, s.
        drift_ppm: Standard deviation of the rate errors, which are clipped at twice this value.
    """

    behind: tuple[float, float] = (0.5, 9.0)
    drift_ppm: float = 50.0


@dataclass(frozen=True)
class Timing:
    """Frame rates and clocks of the cameras."""

    rate: float = 30.0  # Hz; rate of the ground truth and of the detection sets
    # Hz; assigned to the cameras in rotation; empty: all cameras use `rate`
    camera_rates: tuple[float, ...] = ()
    phase: float = 0.0  # s; first exposures are uniform within +- this
    drift_ppm: float = 0.0  # standard deviation of the cameras' rate errors
    stamp_jitter: float = 0.0  # s; standard deviation of timestamp minus exposure
    drop: float = 0.0  # probability that a camera's frame is lost
    generators: tuple[Generator, ...] = ()  # assigned in rotation; they replace rates, phases and drifts
    own_clocks: OwnClocks | None = None  # clocks of the cameras, which also record sound


IN_STEP = Timing()


@dataclass(frozen=True, eq=False)
class ExposureSchedule:
    """Schedule of F sets of C cameras, times in s.

    Args:
        ticks: Instants (F,) of the sets and of the ground truth.
        exposures: True exposure time (F, C) of each camera, NaN = no image in this set.
        stamps: Timestamp (F, C) of each exposure.
        rates: Frame rate (C,) of each camera, Hz.
    """

    ticks: Array
    exposures: Array
    stamps: Array
    rates: Array

    def numbers(self, camera: int) -> Array:
        """Return the numbers (N,) int of a camera's exposures, in frame periods since the first.

        Lost exposures are left out.
        """
        exposures = self.exposures[:, camera]
        there = exposures[~np.isnan(exposures)]
        numbers: Array = np.rint((there - there[0]) * self.rates[camera]).astype(int)
        return numbers


def make_schedule(seed: Sequence[int], timing: Timing, frames: int, cameras: int) -> ExposureSchedule:
    """Assign every camera's exposures to the sets nearest in time.

    A longer schedule begins with a shorter one.
    """
    clocks, losses, noise = (np.random.default_rng([*seed, k]) for k in range(3))
    rates = np.resize(timing.camera_rates or (timing.rate,), cameras)
    phases = clocks.uniform(-timing.phase, timing.phase, cameras)
    periods = (1.0 + 1e-6 * timing.drift_ppm * clocks.standard_normal(cameras)) / rates
    if timing.generators:
        locked = [timing.generators[k % len(timing.generators)] for k in range(cameras)]
        rates = np.array([generator.true_rate for generator in locked])
        phases, periods = np.array([generator.begin_s for generator in locked]), 1.0 / rates
    exposures = np.full((frames, cameras), np.nan)
    for camera in range(cameras):
        numbers = np.arange(-2, int(frames * rates[camera] / timing.rate) + 3)
        times = phases[camera] + periods[camera] * numbers
        groups = np.rint(times * timing.rate).astype(int)
        groups, first = np.unique(groups, return_index=True)  # keep the first of two exposures in one set
        inside = (groups >= 0) & (groups < frames)
        exposures[groups[inside], camera] = times[first[inside]]
    exposures[losses.random((frames, cameras)) < timing.drop] = np.nan
    stamps = exposures + timing.stamp_jitter * noise.standard_normal((frames, cameras))
    return ExposureSchedule(np.arange(frames) / timing.rate, exposures, stamps, rates)


@dataclass(frozen=True)
class SimulatedCameraClock:
    """Clock of a camera. At time t (s) it shows OWN_EPOCH_NS - behind_s + t (1 + drift)."""

    behind_s: float = 0.0
    drift: float = 0.0

    def stamp_ns(self, seconds: float) -> int:
        """Return the time (ns) that the clock shows at a time of the schedule (s)."""
        return OWN_EPOCH_NS + round(1e9 * (float(seconds) * (1.0 + self.drift) - self.behind_s))


def camera_clocks(seed: Sequence[int], timing: Timing, cameras: int) -> tuple[SimulatedCameraClock, ...]:
    """Return each camera's own clock, the first one exact, or () if the cameras share a clock."""
    if timing.own_clocks is None:
        return ()
    rng = np.random.default_rng([*seed, 5])
    behind = rng.uniform(*timing.own_clocks.behind, cameras)
    drift = 1e-6 * timing.own_clocks.drift_ppm * np.clip(rng.standard_normal(cameras), -2.0, 2.0)
    behind[0] = drift[0] = 0.0
    return tuple(SimulatedCameraClock(float(b), float(d)) for b, d in zip(behind, drift))


def to_stamp(seconds: float) -> int:
    """Return the timestamp (ns) of a time (s)."""
    return EPOCH_NS + round(float(seconds) * 1e9)
