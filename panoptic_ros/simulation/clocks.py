"""Simulated clocks with exact truth.

Devices receive timecode, device clocks stamp cameras, and clocks have faults.

True time is in ns since the start. Master time is the first label of the timecode plus true time. Readings
are generated without audio, so that hours of simulation are fast; `ltc_signal` generates the audio.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from types import MappingProxyType

import numpy as np

from panoptic_ros.domain import FrameRate, Timecode, TimecodeReading

SECOND = 1_000_000_000
# (arrival time in s, stream number, item)
Stream = Iterator[tuple[float, int, "TimecodeReading | TrueFrame"]]
# spacing of the cameras' frame number ranges, so that a number identifies the camera even after a renaming
FRAMES = 100_000_000


@dataclass(frozen=True)
class SimulatedClock:
    """Clock with an arbitrary start, a rate error, a temperature-dependent wander, and jumps.

    Args:
        offset_ns: Time shown at true time 0, ns.
        drift: Relative rate error; positive runs too fast.
        wander: Amplitude of the slow sinusoidal change of the drift.
        wander_s: Period of that change, s.
        steps: Jumps as (true time s, jump in s; positive puts the clock forward).
    """

    offset_ns: int = 0
    drift: float = 0.0
    wander: float = 0.0
    wander_s: float = 1800.0
    steps: tuple[tuple[float, float], ...] = ()

    def stamp(self, true_ns: int) -> int:
        """Return the time (ns) that the clock shows at a true time (ns)."""
        seconds = true_ns / SECOND
        turn = 2.0 * np.pi / self.wander_s
        gained = self.drift * seconds + self.wander / turn * (1.0 - np.cos(turn * seconds))
        gained += sum(step for at, step in self.steps if seconds >= at)
        stamp_ns: int = self.offset_ns + true_ns + round(SECOND * gained)
        return stamp_ns


@dataclass(frozen=True)
class TimecodeDevice:
    """Device that receives timecode.

    Args:
        clock: Clock of the device.
        rate: Frame rate of the received timecode. All generators show the same time.
        noise_s: Standard deviation of a word's measured start, s.
        latency_s: Delay from the start of a word to its reading, s.
        sample_rate: Audio sample rate, Hz.
        silent: Periods (from, to) of true time in s without readings.
    """

    name: str
    clock: SimulatedClock
    rate: FrameRate
    noise_s: float = 1.6e-7
    latency_s: float = 0.2
    sample_rate: float = 48_000.0
    silent: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class SimulatedCamera:
    """Camera whose frames get timestamps from a device's clock.

    Args:
        device: Name of the device.
        rate: Frame rate, Hz.
        phase_s: True time of the first exposure, s.
        lost: Share of frames that are dropped.
        latency_s: Delay from exposure to arrival, s.
        off: Periods (from, to) of true time in s without frames.
    """

    name: str
    device: str
    rate: Fraction
    phase_s: float = 0.0
    lost: float = 0.0
    latency_s: float = 0.05
    off: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class TrueFrame:
    """Frame with its timestamp and its true exposure time."""

    camera: str
    stamp_ns: int
    number: int
    true_ns: int


@dataclass(frozen=True)
class ClockWorld:
    """Complete simulation of devices and cameras with their clocks.

    Args:
        seconds: Duration of the simulation, s.
        first_s: Master time of the start in s of the day. A multiple of 1001 s fits all frame rates.
        jumps: Jumps of all generators as (true time s, jump in s; positive puts them forward).
        swap: (true time s, names). From this time on, devices and cameras report under other names, each with
            its own clock and data.
    """

    devices: Sequence[TimecodeDevice]
    cameras: Sequence[SimulatedCamera]
    seconds: float
    first_s: int = 1001
    jumps: tuple[tuple[float, Fraction], ...] = ()
    swap: tuple[float, Mapping[str, str]] = (float("inf"), MappingProxyType({}))
    seed: int = 0

    def master_ns(self, true_ns: int) -> int:
        """Return the master time (ns) of a true time (ns)."""
        return self.first_s * SECOND + true_ns

    def events(self) -> Iterator[TimecodeReading | TrueFrame]:
        """Yield readings and frames in the order of their arrival."""
        readings = (self._readings(device, k) for k, device in enumerate(self.devices))
        frames = (self._frames(camera, k) for k, camera in enumerate(self.cameras))
        for _, _, item in heapq.merge(*readings, *frames, key=lambda event: event[:2]):
            yield item

    def _name(self, name: str, true_s: float) -> str:
        at, names = self.swap
        return names.get(name, name) if true_s >= at else name

    def _readings(self, device: TimecodeDevice, order: int) -> Stream:
        rng = np.random.default_rng([self.seed, order])
        rate = device.rate.exact
        first = round(self.first_s * rate)
        for k in range(int(self.seconds * rate)):
            true_ns = round(k * SECOND / rate)
            seconds = true_ns / SECOND
            noise = device.noise_s * rng.standard_normal()
            if _within(seconds, device.silent):
                continue
            shift = sum(round(jump * rate) for at, jump in self.jumps if seconds >= at)
            reading = TimecodeReading(
                self._name(device.name, seconds),
                device.clock.stamp(true_ns) + round(SECOND * noise),
                Timecode.from_frame_count(first + k + shift, device.rate),
                device.sample_rate * (seconds + noise),
                device.sample_rate * device.noise_s,
            )
            yield seconds + device.latency_s, order, reading

    def _frames(self, camera: SimulatedCamera, order: int) -> Stream:
        rng = np.random.default_rng([self.seed, 1000 + order])
        clock = next(device.clock for device in self.devices if device.name == camera.device)
        for k in range(int(self.seconds * camera.rate)):
            true_ns = round(SECOND * camera.phase_s) + round(k * SECOND / camera.rate)
            seconds = true_ns / SECOND
            if rng.random() < camera.lost or _within(seconds, camera.off):
                continue
            name = self._name(camera.name, seconds)
            frame = TrueFrame(name, clock.stamp(true_ns), FRAMES * order + k, true_ns)
            yield seconds + camera.latency_s, 1000 + order, frame


def _within(seconds: float, spans: Sequence[tuple[float, float]]) -> bool:
    return any(start <= seconds < end for start, end in spans)
