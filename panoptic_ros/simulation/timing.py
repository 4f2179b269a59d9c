"""When cameras expose, and which exposures belong together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from panoptic_ros.simulation.generators import Generator

Array = np.ndarray
EPOCH_NS = 1_000_000_000  # stamp of t = 0
OWN_EPOCH_NS = 60_000_000_000  # the same of the first camera, where each has a clock of its own


@dataclass(frozen=True)
class OwnClocks:
    """Cameras that stamp frames and sound by clocks of their own, behind that of the first camera.

    Args:
        behind: s, from and to. drift_ppm: standard deviation of their rate errors; twice of it is the most.
    """

    behind: tuple[float, float] = (0.5, 9.0)
    drift_ppm: float = 50.0


@dataclass(frozen=True)
class Timing:
    """Frame rates and clocks of the cameras."""

    rate: float = 30.0  # Hz, of the truth and of the sets
    camera_rates: tuple[float, ...] = ()  # Hz, dealt out in turn; empty: all `rate`
    phase: float = 0.0  # s, cameras start uniformly within +- this
    drift_ppm: float = 0.0  # standard deviation of the cameras' rate errors
    stamp_jitter: float = 0.0  # s, standard deviation of stamp minus exposure
    drop: float = 0.0  # probability that a camera's frame is lost
    generators: tuple[Generator, ...] = ()  # dealt out in turn, in place of rates, phases and drifts
    own_clocks: OwnClocks | None = None  # of the cameras, which hear what people say


IN_STEP = Timing()


@dataclass(frozen=True, eq=False)
class Schedule:
    """F sets of C cameras; times in s.

    ticks: (F,) instants of the sets and of the truth.
    exposures: (F, C) when each camera exposed, NaN = no image in this set.
    stamps: (F, C) when it says that it did.
    rates: (C,) frames per second.
    """

    ticks: Array
    exposures: Array
    stamps: Array
    rates: Array

    def numbers(self, camera: int) -> Array:
        """(N,) int: of a camera's exposures, in its frame periods since the first; lost ones are left out."""
        exposures = self.exposures[:, camera]
        there = exposures[~np.isnan(exposures)]
        numbers: Array = np.rint((there - there[0]) * self.rates[camera]).astype(int)
        return numbers


def make_schedule(seed: Sequence[int], timing: Timing, frames: int, cameras: int) -> Schedule:
    """Deal every camera's exposures out to the sets nearest in time.

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
        groups, first = np.unique(groups, return_index=True)  # the first of two in one set
        inside = (groups >= 0) & (groups < frames)
        exposures[groups[inside], camera] = times[first[inside]]
    exposures[losses.random((frames, cameras)) < timing.drop] = np.nan
    stamps = exposures + timing.stamp_jitter * noise.standard_normal((frames, cameras))
    return Schedule(np.arange(frames) / timing.rate, exposures, stamps, rates)


@dataclass(frozen=True)
class CameraClock:
    """What a camera's clock shows: OWN_EPOCH_NS - behind_s + t (1 + drift)."""

    behind_s: float = 0.0
    drift: float = 0.0

    def stamp_ns(self, seconds: float) -> int:
        """At a time of the schedule."""
        return OWN_EPOCH_NS + round(1e9 * (float(seconds) * (1.0 + self.drift) - self.behind_s))


def camera_clocks(seed: Sequence[int], timing: Timing, cameras: int) -> tuple[CameraClock, ...]:
    """The own clock of each camera, the first of which is right; none if they share one."""
    if timing.own_clocks is None:
        return ()
    rng = np.random.default_rng([*seed, 5])
    behind = rng.uniform(*timing.own_clocks.behind, cameras)
    drift = 1e-6 * timing.own_clocks.drift_ppm * np.clip(rng.standard_normal(cameras), -2.0, 2.0)
    behind[0] = drift[0] = 0.0
    return tuple(CameraClock(float(b), float(d)) for b, d in zip(behind, drift))


def to_stamp(seconds: float) -> int:
    """The stamp (ns) of a time (s)."""
    return EPOCH_NS + round(float(seconds) * 1e9)
