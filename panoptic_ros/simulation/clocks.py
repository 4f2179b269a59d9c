"""Clocks with exact truth: devices that hear timecode, cameras on their clocks, and what happens to them.

True time is ns since the start; master time is that of the timecode's first label plus true time. Readings
are made without audio, so that hours are quick; `ltc_signal` makes the audio.
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
Stream = Iterator[tuple[float, int, "TimecodeReading | CameraFrame"]]  # arrival, order, item
FRAMES = 100_000_000  # numbers of frames are those of a camera, whatever its name


@dataclass(frozen=True)
class SimulatedClock:
    """A clock that starts anywhere, runs too fast, wanders with the temperature, and may jump.

    Args:
        wander: amplitude of the drift's slow wave; wander_s: its period.
        steps: (true s, s by which the clock is put forward then).
    """

    offset_ns: int = 0
    drift: float = 0.0
    wander: float = 0.0
    wander_s: float = 1800.0
    steps: tuple[tuple[float, float], ...] = ()

    def stamp(self, true_ns: int) -> int:
        """What it shows at a true time."""
        seconds = true_ns / SECOND
        turn = 2.0 * np.pi / self.wander_s
        gained = self.drift * seconds + self.wander / turn * (1.0 - np.cos(turn * seconds))
        gained += sum(step for at, step in self.steps if seconds >= at)
        stamp_ns: int = self.offset_ns + true_ns + round(SECOND * gained)
        return stamp_ns


@dataclass(frozen=True)
class HearingDevice:
    """A device that hears timecode.

    Args:
        rate: of the timecode that it hears; all generators show the same time.
        noise_s: standard deviation of a word's start.
        latency_s: from a word's start to its reading.
        silent: (from, to) true s in which it is off.
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
    """A camera whose frames are stamped by a device's clock.

    Args:
        lost: share of the frames that are dropped; off: (from, to) true s without any.
        latency_s: from exposure to arrival.
    """

    name: str
    device: str
    rate: Fraction
    phase_s: float = 0.0
    lost: float = 0.0
    latency_s: float = 0.05
    off: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class CameraFrame:
    """A frame, and when it was really exposed."""

    camera: str
    stamp_ns: int
    number: int
    true_ns: int


@dataclass(frozen=True)
class ClockWorld:
    """All of it.

    Args:
        first_s: master time of the start, s of the day; a multiple of 1001 s fits all rates.
        jumps: (true s, s by which all generators are set on then).
        swap: (true s, names): from then on devices and cameras have other names, with all that hangs on
            them.
    """

    devices: Sequence[HearingDevice]
    cameras: Sequence[SimulatedCamera]
    seconds: float
    first_s: int = 1001
    jumps: tuple[tuple[float, Fraction], ...] = ()
    swap: tuple[float, Mapping[str, str]] = (float("inf"), MappingProxyType({}))
    seed: int = 0

    def master_ns(self, true_ns: int) -> int:
        """Master time of a true time."""
        return self.first_s * SECOND + true_ns

    def events(self) -> Iterator[TimecodeReading | CameraFrame]:
        """Readings and frames in the order of their arrival."""
        readings = (self._readings(device, k) for k, device in enumerate(self.devices))
        frames = (self._frames(camera, k) for k, camera in enumerate(self.cameras))
        for _, _, item in heapq.merge(*readings, *frames, key=lambda event: event[:2]):
            yield item

    def _name(self, name: str, true_s: float) -> str:
        at, names = self.swap
        return names.get(name, name) if true_s >= at else name

    def _readings(self, device: HearingDevice, order: int) -> Stream:
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
            frame = CameraFrame(name, clock.stamp(true_ns), FRAMES * order + k, true_ns)
            yield seconds + camera.latency_s, 1000 + order, frame


def _within(seconds: float, spans: Sequence[tuple[float, float]]) -> bool:
    return any(start <= seconds < end for start, end in spans)
