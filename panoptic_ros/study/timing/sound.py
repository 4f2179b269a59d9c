"""Studies of clock offsets from sound: errors beside stated standard deviations, and control rooms.

In control rooms no offset can be found.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from panoptic_ros.domain import DetectionSet
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.clocks_from_motion import find_clocks
from panoptic_ros.graph.recording import InMemoryRecording
from panoptic_ros.offsets.clocks import CameraClocks
from panoptic_ros.offsets.regroup import regroup
from panoptic_ros.offsets.sound import SoundClocks, SoundClocksConfig
from panoptic_ros.offsets.sound.travel import SPEED_OF_SOUND
from panoptic_ros.running.arguments import within
from panoptic_ros.simulation import Simulation, simulate
from panoptic_ros.simulation.heard import heard_blocks
from panoptic_ros.simulation.scenes import SCENES
from panoptic_ros.simulation.skeleton import SKELETON
from panoptic_ros.stage import Progress, StageContext, each, untold
from panoptic_ros.study.options import add_seeds, known_names, numbers, words
from panoptic_ros.study.study import Case, Column, Result, Row, Study
from panoptic_ros.study.timing.offsets import LARGEST, mpjpe_of, sequence_of
from panoptic_ros.study.timing.sound_rooms import CASES, make_room

Array = np.ndarray
ALLOWED_S = 0.005  # s, limit of the error beyond the travel time of sound
MOTION_SCENE = "own-clocks-3p5v"


class Sound(Study):
    """Clocks from sound in rooms: errors beside stated deviations, and controls without a solution.

    Errors are those of timestamps relative to the first microphone's clock. They are the maximum over the
    begin, middle and end of the common recording time.
    """

    columns = (
        Column("case", "case"),
        Column("microphones", "mics"),
        Column("known", "known"),
        Column("devices", "of"),
        Column("median_s", "median ms", ".1f", 1e3),
        Column("p95_s", "p95", ".1f", 1e3),
        Column("worst_s", "worst", ".1f", 1e3),
        Column("stated_s", "stated", ".1f", 1e3),
        Column("z2", "z2", ".2f"),
        Column("drift_z2", "drift z2", ".2f"),
        Column("wrong", "wrong"),
        Column("cpu_s", "CPU s", ".1f"),
    )

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        parser.add_argument(
            "--cases", type=words, default=list(CASES), metavar="NAME,NAME", help="cases; default all"
        )
        parser.add_argument(
            "--microphones",
            type=numbers(2, 64),
            default=(2, 4, 8),
            metavar="N,N",
            help="numbers of microphones; default 2,4,8",
        )
        add_seeds(parser, "1000:1010")
        parser.add_argument(
            "--seconds",
            type=within(float, 5.0, 3600.0),
            default=40.0,
            metavar="S",
            help="length of the recording; default 40",
        )
        parser.add_argument(
            "--snr-db",
            type=float,
            default=10.0,
            metavar="DB",
            help="signal-to-noise ratio of each microphone; default 10",
        )
        parser.add_argument(
            "--unplaced", action="store_true", help="treat the positions of microphones as unknown"
        )

    def cases(self) -> list[Case]:
        """See `Study`."""
        known_names(self.options.cases, CASES, "case")
        return [
            Case(f"{name}, {count}", (name, count), float(count))
            for name in self.options.cases
            for count in self.options.microphones
        ]

    def measure(self, case: Case, progress: Progress) -> list[Row]:
        """See `Study`."""
        (name, count), seeds = case.request, self.options.seeds
        found = [_room(name, count, s, self.options) for s in each(seeds, len(seeds), progress, "takes")]
        return [{"case": name, "microphones": count} | _summary(found)]

    def lines(self, result: Result) -> Iterator[str]:
        """See `Study`."""
        yield from super().lines(result)
        yield (
            "z2: mean (error / stated deviation)^2; wrong: known, and off by more than 5 ms and the travel "
            "time of sound between the two microphones"
        )
        yield from (
            f"{name}: {CASES[name].about}" for name in dict.fromkeys(r["case"] for r in result["rows"])
        )


class SoundMotion(Study):
    """Cameras whose clocks are seconds apart: sound, motion after it, and motion of stamps 60 ms off.

    The last method starts from true clocks plus random offsets of up to 60 ms. A fourth row has the true
    clocks.
    """

    columns = (
        Column("clocks", f"{MOTION_SCENE}, clocks by"),
        Column("rms_s", "rms ms", ".2f", 1e3),
        Column("worst_s", "worst ms", ".2f", 1e3),
        Column("mpjpe_m", "MPJPE mm", ".2f", 1e3),
    )

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        add_seeds(parser, "1000:1010")

    def measure(self, case: Case, progress: Progress) -> Iterator[Row]:
        """See `Study`."""
        seeds = self.options.seeds
        told = each(seeds, len(seeds), progress, "takes")
        takes = [_take(simulate(SCENES[MOTION_SCENE], seed)) for seed in told]
        for name in takes[0]:
            yield {
                "clocks": name,
                "rms_s": _rms(np.concatenate([take[name][0] for take in takes])),
                "worst_s": float(max(np.abs(take[name][0]).max() for take in takes)),
                "mpjpe_m": float(np.mean([take[name][1] for take in takes])),
            }


def _room(name: str, count: int, seed: int, args: argparse.Namespace) -> dict[str, Any]:
    """Find the clocks of one room and return their errors relative to the first microphone's clock."""
    heard = make_room(CASES[name], count, seed, args.seconds, args.snr_db)
    names = list(heard.recorders)
    places = {} if args.unplaced else heard.places
    work = SoundClocks(SoundClocksConfig({n: n for n in names}, places, trusted_camera=names[0]))
    start = time.process_time()
    clocks = work.run(heard.recording, untold).clocks
    spent = time.process_time() - start
    known = clocks.known.copy()
    known[0] = False
    begin, end = heard.shared
    instants = np.array([begin, 0.5 * (begin + end), end])
    stamps = np.array([[recorder.stamp_s(t) for t in instants] for recorder in heard.recorders.values()])
    offsets, stated = clocks.stated_at(np.rint(1e9 * stamps).astype(np.int64))
    error = (offsets - (stamps[0] - stamps))[known]
    base = heard.places[names[0]]
    ways = np.array([np.linalg.norm(heard.places[n] - base) for n in names]) / SPEED_OF_SOUND
    largest = np.abs(error).max(axis=1)
    speeds = np.array([recorder.drift for recorder in heard.recorders.values()])
    drift = (clocks.drifts - ((1.0 + speeds[0]) / (1.0 + speeds) - 1.0))[known]
    return {
        "error": error,
        "stated": stated[known],
        "largest": largest,
        "known": int(known.sum()),
        "beyond": largest - ways[known],
        "drift": drift / clocks.drift_deviations[known],
        "devices": count - 1,
        "cpu": spent,
    }


def _summary(takes: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    def joined(key: str) -> Array:
        return np.concatenate([take[key] for take in takes])

    error = joined("largest")
    row: dict[str, Any] = {
        "known": sum(take["known"] for take in takes),
        "devices": sum(take["devices"] for take in takes),
        "cpu_s": float(np.mean([take["cpu"] for take in takes])),
    }
    if len(error):
        row |= {
            "median_s": float(np.median(error)),
            "p95_s": float(np.quantile(error, 0.95)),
            "worst_s": float(error.max()),
            "stated_s": _rms(joined("stated")),
            "z2": _rms(joined("error") / joined("stated")) ** 2,
            "drift_z2": _rms(joined("drift")) ** 2,
            "wrong": int((joined("beyond") > ALLOWED_S).sum()),
        }
    return row


def _take(take: Simulation) -> dict[str, tuple[Array, float]]:
    """Return, per method, the clock errors (C,) s relative to their mean, and the MPJPE (m)."""
    context, configs = StageContext(take.rig, SKELETON), configure({})
    sets, truth = list(take.detection_sets()), sequence_of(take)
    names = take.rig.names
    blocks: dict[str | tuple[str, str], list[Any]] = {("audio", name): [] for name in names}
    for _, block in heard_blocks(take):
        blocks["audio", block.device].append(block)
    places = {camera.name: camera.centre for camera in take.rig.cameras}
    sound = SoundClocks(
        SoundClocksConfig({name: name for name in names}, places, trusted_camera=names[0])
    ).run(InMemoryRecording(blocks), untold)
    heard = regroup(sets, sound.clocks.corrections(sets))
    refined = find_clocks(heard, context, configs, names[0])
    right = _right(take)
    good = regroup(sets, right.corrections(sets, every=True))
    off = np.random.default_rng(take.seed).uniform(-LARGEST, LARGEST, len(names))
    off[0] = 0.0
    late = replace(right, offsets=right.offsets + off)
    alone = find_clocks(regroup(sets, late.corrections(sets, every=True)), context, configs, names[0])

    def outcome(clocks: CameraClocks, result: Sequence[DetectionSet]) -> tuple[Array, float]:
        return _errors(take, clocks), mpjpe_of(truth, result, context, configs)

    return {
        "sound": outcome(sound.clocks, heard),
        "sound, then motion": outcome(sound.clocks.then(refined.clocks), refined.sets),
        "motion, 60 ms off": outcome(_everywhere(late).then(alone.clocks), alone.sets),
        "good stamps": outcome(_everywhere(right), good),
    }


def _right(take: Simulation) -> CameraClocks:
    """Return the true clocks."""
    middle = 0.5 * take.seconds
    reference = take.master_ns(middle)
    drifts = np.array([1.0 / (1.0 + clock.drift) - 1.0 for clock in take.clocks])
    since = np.array([1e-9 * (reference - clock.stamp_ns(middle)) for clock in take.clocks])
    return replace(
        CameraClocks.unknown(take.rig.names, reference), offsets=since * (1.0 + drifts), drifts=drifts
    )


def _everywhere(clocks: CameraClocks) -> CameraClocks:
    return replace(clocks, held=np.ones(len(clocks.cameras), bool))


def _errors(take: Simulation, clocks: CameraClocks) -> Array:
    """Return the differences (C,) s of corrected timestamps at one instant, relative to their mean."""
    middle = 0.5 * take.seconds
    stamps = np.array([clock.stamp_ns(middle) - clocks.reference_ns for clock in take.clocks]) * 1e-9
    used = clocks.applied
    found = stamps + np.where(used, clocks.offsets + clocks.drifts * stamps, 0.0)
    return np.asarray(found - found.mean())


def _rms(values: Array) -> float:
    return float(np.sqrt((values**2).mean())) if len(values) else float("nan")
