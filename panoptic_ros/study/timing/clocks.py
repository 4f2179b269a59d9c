"""The study `clocks`: errors of timecode-corrected timestamps, over an hour and after clock events."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any

import numpy as np

from panoptic_ros.clocks.config import ClocksConfig
from panoptic_ros.clocks.stage import ClocksStage
from panoptic_ros.clocks.timeline import day_ns
from panoptic_ros.domain import (
    AudioBlock,
    Camera,
    DetectionSet,
    FrameRate,
    Rig,
    SkeletonModel,
    Timecode,
    ViewDetections,
)
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.running.arguments import within
from panoptic_ros.simulation.clocks import (
    ClockWorld,
    SimulatedCamera,
    SimulatedClock,
    TimecodeDevice,
    TrueFrame,
)
from panoptic_ros.simulation.ltc_signal import encode_ltc
from panoptic_ros.stage import Notice, Progress, StageContext, StepResult
from panoptic_ros.study.options import add_seeds
from panoptic_ros.study.study import Case, Column, Result, Row, Study
from panoptic_ros.sync import SyncConfig, SyncStage
from panoptic_ros.timecode.config import TimecodeConfig
from panoptic_ros.timecode.stage import TimecodeStage

SECOND = 1_000_000_000
PAL = FrameRate(25, Fraction(25))
NTSC = FrameRate(30, Fraction(30000, 1001))
SKELETON = SkeletonModel("dot", ("a", "b"), 0, ((0, 1),), 0)
TELLING = ("clocks.timecode_jump",)  # information notices to count, because the decoder warns of the event
WRONG_S = 1e-3  # s, a timestamp with a larger error is treated as wrong


@dataclass
class SyncOutcome:
    """Result of the clocks and sync stages on a simulated world.

    Args:
        errors_s: (s) timestamp minus true master time of every view in a set.
        ages_s: (s) true time of these views.
        cameras: Cameras of these views.
        sets: Number of sets.
        twice: Frames that were used more than once.
        frames: All frames.
        notices: Notices of both stages.
    """

    errors_s: list[float] = field(default_factory=list)
    ages_s: list[float] = field(default_factory=list)
    cameras: list[str] = field(default_factory=list)
    sets: int = 0
    twice: int = 0
    frames: int = 0
    notices: list[Notice] = field(default_factory=list)


def run_world(world: ClockWorld, deadline_s: float = 1.5) -> SyncOutcome:
    """Run timecode readings through the clocks stage, then its models and all frames through sync."""
    outcome = SyncOutcome()
    truth: dict[tuple[str, int], int] = {}
    used: set[tuple[str, int]] = set()
    names = [camera.name for camera in world.cameras]
    entries = tuple(f"{camera.name}={camera.device}" for camera in world.cameras)
    clocks = ClocksStage(ClocksConfig())
    sync = SyncStage(SyncConfig(deadline_s=deadline_s, clocks=entries), _context(names))

    def keep(result: StepResult[DetectionSet]) -> None:
        outcome.notices += result.notices
        for item in result.outputs:
            outcome.sets += 1
            for view in item.views:
                key = (view.camera, view.frame_number)
                outcome.twice += key in used
                used.add(key)
                true_ns = truth.pop(key, None)
                if true_ns is not None:
                    outcome.errors_s.append((view.stamp_ns - world.master_ns(true_ns)) / SECOND)
                    outcome.ages_s.append(true_ns / SECOND)
                    outcome.cameras.append(view.camera)

    for event in world.events():
        if isinstance(event, TrueFrame):
            outcome.frames += 1
            truth[(event.camera, event.number)] = event.true_ns
            keep(sync.step(_view(event)))
            continue
        result = clocks.step(event)
        outcome.notices += result.notices
        for model in result.outputs:
            keep(sync.step(model))
    keep(sync.flush())
    return outcome


def _context(names: list[str]) -> StageContext:
    intrinsics = Intrinsics(np.array([[100.0, 0, 50], [0, 100, 50], [0, 0, 1]]), np.zeros(5))
    rig = Rig(tuple(Camera(name, (100, 100), intrinsics, Rigid.identity()) for name in names))
    return StageContext(rig, SKELETON)


def _view(frame: TrueFrame) -> ViewDetections:
    return ViewDetections(
        frame.camera,
        frame.stamp_ns,
        frame.number,
        (100, 100),
        SKELETON.hash,
        np.zeros((0, 2, 2)),
        np.zeros((0, 2)),
        np.zeros(0),
    )


def mixed_world(seconds: float, seed: int = 0) -> ClockWorld:
    """Return a rig of two 25 fps and two 29.97 fps cameras with clocks that drift by up to 50 ppm.

    The 25 fps cameras share one host clock. The 29.97 fps cameras have a clock each.
    """

    def clock(offset: int, drift: float) -> SimulatedClock:
        return SimulatedClock(offset, drift, wander=1e-6)

    devices = (
        TimecodeDevice("host", clock(1_700_000_000 * SECOND, 50e-6), PAL),
        TimecodeDevice("kinect1", clock(200_000 * SECOND, -50e-6), NTSC),
        TimecodeDevice("kinect2", clock(77_000 * SECOND, 20e-6), NTSC, sample_rate=16_000.0, noise_s=1e-6),
    )
    cameras = (
        SimulatedCamera("vga1", "host", Fraction(25), 0.003, 0.01),
        SimulatedCamera("vga2", "host", Fraction(25), 0.003, 0.01),
        SimulatedCamera("kinect1", "kinect1", Fraction(30000, 1001), 0.011, 0.01),
        SimulatedCamera("kinect2", "kinect2", Fraction(30000, 1001), 0.027, 0.02),
    )
    return ClockWorld(devices, cameras, seconds, seed=seed)


def events(seconds: float = 40.0, at: int = 20) -> dict[str, ClockWorld]:
    """Return the mixed rig with one clock event each, at `at` s."""
    calm = mixed_world(seconds)
    host, one, two = calm.devices
    midnight = replace(calm, first_s=86_400 - at, devices=[replace(d, rate=PAL) for d in calm.devices])

    def stepped(step: float) -> ClockWorld:
        changed = replace(one, clock=replace(one.clock, steps=((float(at), step),)))
        return replace(calm, devices=(host, changed, two))

    swapped = {"kinect1": "kinect2", "kinect2": "kinect1"}
    off = ((float(at), 0.25 * at + 0.75 * seconds),)
    return {
        "nothing": calm,
        "clock forward 0.1 s": stepped(0.1),
        "clock forward 0.41 s": stepped(0.41),
        "clock back 0.41 s": stepped(-0.41),
        "clock forward 1 h": stepped(3600.0),
        "clock back 1 day": stepped(-86_400.0),
        "device stops and resumes": replace(
            calm,
            devices=(host, replace(one, silent=off), two),
            cameras=[replace(c, off=off) if c.name == "kinect1" else c for c in calm.cameras],
        ),
        "timecode jumps by 10 s": replace(calm, jumps=((float(at), Fraction(10)),)),
        "timecode jumps by -2 s": replace(calm, jumps=((float(at), Fraction(-2)),)),
        "midnight": midnight,
        "re-jam by 3 frames at midnight": replace(midnight, jumps=((float(at), Fraction(3, 25)),)),
        "two devices swap": replace(calm, swap=(float(at), swapped)),
        "0.1 s of audio lost": replace(
            calm, devices=(host, replace(one, silent=((float(at), at + 0.1),)), two)
        ),
    }


def audio_error_s(seconds: float = 20.0) -> dict[str, float]:
    """Return the largest error (s) of the clock models from decoded audio at 25 and 29.97 fps and 20 dB."""
    worst: dict[str, float] = {}
    for name, rate, ppm in (("25", PAL, 50.0), ("29.97", NTSC, -50.0)):
        start = Timecode.from_frame_count(100_000, rate)
        signal = encode_ltc(start, int(seconds * rate.exact), 48_000, lead=333.3)
        rng = np.random.default_rng(1)
        level = 0.1 * float(np.sqrt(np.mean(np.square(signal.samples))))
        samples = (signal.samples + level * rng.standard_normal(len(signal.samples))).astype(np.float32)
        timecode, clocks = TimecodeStage(TimecodeConfig()), ClocksStage(ClocksConfig())
        errors = []
        for first in range(0, len(samples), 1024):
            stamp = SECOND + round(SECOND * first / 48_000 * (1 + 1e-6 * ppm))
            block = AudioBlock("mic", stamp, first, 48_000, samples[first : first + 1024])
            for reading in timecode.step(block).outputs:
                for model in clocks.step(reading).outputs:
                    at = model.until_ns
                    sample = (at - SECOND) / SECOND * 48_000 / (1 + 1e-6 * ppm)
                    true_s = (sample - 333.3) / 48_000
                    master = model.master_from_device(at)[0] - day_ns(start)
                    errors.append(master / SECOND - true_s)
        worst[name] = float(np.abs(errors).max()) if errors else float("nan")
    return worst


class Clocks(Study):
    """An hour of mixed rates, everything that clocks do, and real audio.

    The events are clock steps, dropouts, timecode jumps, midnight and swapped devices.
    """

    columns = (
        Column("world", ""),
        Column("sets", "sets"),
        Column("frames", "frames"),
        Column("unused", "unused"),
        Column("twice", "twice"),
        Column("wrong", "wrong"),
        Column("error_max_us", "max us", ".2f"),
        Column("error_rms_us", "rms us", ".2f"),
        Column("recovered_s", "gap s", ".2f"),
        Column("notices", "notices"),
    )

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        parser.add_argument(
            "--minutes",
            type=within(float, 0.1, 6000.0),
            default=60.0,
            metavar="M",
            help="length of the long capture; default 60",
        )
        parser.add_argument(
            "--only", default="", metavar="TEXT", help="only events whose names contain this text"
        )
        add_seeds(parser, "0")

    def cases(self) -> list[Case]:
        """See `Study`."""
        minutes = self.options.minutes
        long = [
            Case(f"25 and 29.97 fps, {minutes:g} min", mixed_world(60.0 * minutes, seed), 12.0)
            for seed in self.options.seeds
        ]
        return long + [Case(name, world) for name, world in events().items() if self.options.only in name]

    def measure(self, case: Case, progress: Progress) -> list[Row]:
        """See `Study`."""
        return [{"world": case.title} | _row(run_world(case.request))]

    def summary(self, rows: list[Row]) -> dict[str, Any]:
        """See `Study`."""
        return {"audio_error_us": {rate: 1e6 * error for rate, error in audio_error_s().items()}}

    def lines(self, result: Result) -> Iterator[str]:
        """See `Study`."""
        yield from super().lines(result)
        for rate, error in result["audio_error_us"].items():
            yield f"real audio, {rate} fps, 20 dB: largest error of the clock models {error:.2f} us"


def _row(outcome: SyncOutcome) -> dict[str, Any]:
    errors = np.abs(outcome.errors_s)
    codes = [n.code for n in outcome.notices if n.severity == "warning" or n.code in TELLING]
    told = {code: codes.count(code) for code in sorted(set(codes))}
    return {
        "sets": outcome.sets,
        "frames": outcome.frames,
        "used": len(errors),
        "unused": outcome.frames - len(errors),
        "twice": outcome.twice,
        "wrong": int((errors > WRONG_S).sum()),
        "error_max_us": 1e6 * float(errors.max()),
        "error_rms_us": 1e6 * float(np.sqrt(np.mean(np.square(errors)))),
        "recovered_s": recovery_s(outcome),
        "told": told,
        "notices": ", ".join(f"{code} {count}" for code, count in told.items()),
    }


def recovery_s(outcome: SyncOutcome, event_s: float = 20.0) -> float:
    """Return the time (s) from the event to the end of the last gap above 0.5 s of any camera."""
    longest = 0.0
    ages, cameras = np.array(outcome.ages_s), np.array(outcome.cameras)
    for camera in set(outcome.cameras):
        own = np.sort(ages[cameras == camera])
        gaps = own[1:][(np.diff(own) > 0.5) & (own[1:] > event_s)]
        longest = max(longest, float(gaps.max()) - event_s if len(gaps) else 0.0)
    return longest
