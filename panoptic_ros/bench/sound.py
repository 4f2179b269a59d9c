"""Clocks from sound: errors beside stated deviations, and controls in which nothing may be known."""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from panoptic_ros.bench.offsets import LARGEST, mpjpe_of, sequence_of
from panoptic_ros.bench.sound_rooms import CASES, make_room
from panoptic_ros.domain import DetectionSet
from panoptic_ros.errors import UsageError
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.clocks_from_motion import find_clocks
from panoptic_ros.graph.recording import HeldRecording
from panoptic_ros.offsets import CameraClocks, regroup
from panoptic_ros.offsets.sound import SoundClocks, SoundClocksConfig
from panoptic_ros.offsets.sound.travel import SPEED_OF_SOUND
from panoptic_ros.simulation import Simulation, simulate
from panoptic_ros.simulation.heard import heard_blocks
from panoptic_ros.simulation.scenes import SCENES
from panoptic_ros.simulation.skeleton import SKELETON
from panoptic_ros.stage import Progress, StageContext, each, untold

Array = np.ndarray
ALLOWED_S = 0.005  # beside the way of the sound
MOTION = "motion"
MOTION_SCENE = "own-clocks-3p5v"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the bench."""
    parser.add_argument("--cases", default=",".join([*CASES, MOTION]), help="names separated by commas")
    parser.add_argument("--microphones", default="2,4,8", help="numbers separated by commas")
    parser.add_argument("--seeds", default="1000:1010", metavar="FROM:TO", help="takes of each case")
    parser.add_argument("--seconds", type=float, default=40.0, help="length of the recordings")
    parser.add_argument("--snr-db", type=float, default=10.0, help="sound over noise of each microphone")
    parser.add_argument("--unplaced", action="store_true", help="as if nobody knew where microphones are")


def measure(args: argparse.Namespace, progress: Progress = untold) -> dict[str, Any]:
    """All cases.

    Raises:
        UsageError: on unknown cases, or seeds that are none.
    """
    names = args.cases.split(",")
    unknown = [name for name in names if name not in CASES and name != MOTION]
    if unknown:
        raise UsageError(f"there is no case {unknown[0]!r}; there are {', '.join([*CASES, MOTION])}")
    try:
        first, last = (int(part) for part in args.seeds.split(":"))
    except ValueError:
        raise UsageError(f"--seeds {args.seeds}: write FROM:TO, e.g. 1000:1010") from None
    counts = [int(part) for part in args.microphones.split(",")]
    takes = [(name, count) for name in names if name != MOTION for count in counts]
    rows = []
    for name, count in each(takes, len(takes), progress, "rooms"):
        found = [_room(name, count, seed, args) for seed in range(first, last)]
        rows.append({"case": name, "microphones": count} | _summary(found))
    result: dict[str, Any] = {"rooms": rows}
    if MOTION in names:
        result[MOTION] = _after(list(range(first, last)))
    return result


def _room(name: str, count: int, seed: int, args: argparse.Namespace) -> dict[str, Any]:
    """One room: errors of corrected stamps against the first microphone's clock, while all record."""
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


def _after(seeds: Sequence[int]) -> dict[str, Any]:
    """Cameras whose clocks are seconds apart: sound, motion after it, and motion of stamps 60 ms off."""
    takes = [_take(simulate(SCENES[MOTION_SCENE], seed)) for seed in seeds]
    names = takes[0].keys()
    return {
        name: {
            "rms_s": _rms(np.concatenate([take[name][0] for take in takes])),
            "worst_s": float(max(np.abs(take[name][0]).max() for take in takes)),
            "mpjpe_m": float(np.mean([take[name][1] for take in takes])),
        }
        for name in names
    }


def _take(take: Simulation) -> dict[str, tuple[Array, float]]:
    """Errors (C,) s of the clocks about their mean, and MPJPE, m, of each way to get them."""
    context, configs = StageContext(take.rig, SKELETON), configure({})
    sets, truth = list(take.detection_sets()), sequence_of(take)
    names = take.rig.names
    blocks: dict[str | tuple[str, str], list[Any]] = {("audio", name): [] for name in names}
    for _, block in heard_blocks(take):
        blocks["audio", block.device].append(block)
    places = {camera.name: camera.centre for camera in take.rig.cameras}
    sound = SoundClocks(
        SoundClocksConfig({name: name for name in names}, places, trusted_camera=names[0])
    ).run(HeldRecording(blocks), untold)
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
    """The true clocks."""
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
    """By how much corrected stamps of one instant differ (C,) s, about their mean."""
    middle = 0.5 * take.seconds
    stamps = np.array([clock.stamp_ns(middle) - clocks.reference_ns for clock in take.clocks]) * 1e-9
    used = clocks.applied
    found = stamps + np.where(used, clocks.offsets + clocks.drifts * stamps, 0.0)
    return np.asarray(found - found.mean())


def lines(result: dict[str, Any]) -> list[str]:
    """The table."""
    head = "case          mics    known  median ms    p95  worst  stated    z2 drift z2  wrong   cpu s"
    rows = [head] if result["rooms"] else []
    for row in result["rooms"]:
        text = f"{row['case']:<12} {row['microphones']:>5} {row['known']:>4}/{row['devices']:<4}"
        if "z2" in row:
            text += f" {1e3 * row['median_s']:9.1f} {1e3 * row['p95_s']:6.1f} {1e3 * row['worst_s']:6.1f}"
            text += f" {1e3 * row['stated_s']:7.1f} {row['z2']:5.2f} {row['drift_z2']:8.2f} {row['wrong']:6}"
        else:
            text += f" {'-':>9} {'-':>6} {'-':>6} {'-':>7} {'-':>5} {'-':>8} {0:6}"
        rows.append(f"{text} {row['cpu_s']:7.1f}")
    if rows:
        rows += [
            "of stamps against the first microphone's clock, the largest at the begin, middle and end of "
            "what all recorded; z2: mean (error / stated deviation)^2 at these; wrong: known, and off by "
            "more than 5 ms and the way of sound between the two microphones",
        ]
        rows += [f"{name}: {CASES[name].about}" for name in dict.fromkeys(r["case"] for r in result["rooms"])]
    if MOTION in result:
        rows.append(f"{MOTION_SCENE:<24} rms ms   worst ms   MPJPE mm")
        for name, row in result[MOTION].items():
            values = f"{1e3 * row['rms_s']:6.2f} {1e3 * row['worst_s']:10.2f} {1e3 * row['mpjpe_m']:10.2f}"
            rows.append(f"{name:<24} {values}")
    return rows


def _rms(values: Array) -> float:
    return float(np.sqrt((values**2).mean())) if len(values) else float("nan")
