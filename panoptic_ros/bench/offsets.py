"""Clocks from motion: how far found offsets are from the truth, how honest, and what they do for poses."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.bench.shifted_cameras import measure_shifts, shift_lines
from panoptic_ros.domain import DetectionSet
from panoptic_ros.errors import UsageError
from panoptic_ros.evaluation import SkeletonFrame, SkeletonSequence, pair_sequences
from panoptic_ros.evaluation.report import report_of
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.clocks_from_motion import find_clocks
from panoptic_ros.graph.pipeline import records_of
from panoptic_ros.offsets import CameraClocks, regroup
from panoptic_ros.simulation import Simulation, simulate
from panoptic_ros.simulation.people import Person
from panoptic_ros.simulation.scenes import SCENES, Scene
from panoptic_ros.simulation.skeleton import JOINTS, SKELETON
from panoptic_ros.stage import Progress, StageContext, each, untold

Array = np.ndarray
LARGEST = 0.06  # s, of injected offsets
DRIFT = 5e-5  # standard deviation of injected drifts


class _Statue(Person):
    """Somebody who does not move at all."""

    def posture(self, t: Array) -> Any:
        return super().posture(np.zeros_like(t))


def _statue(person: Person) -> Person:
    return _Statue(person.id, person.body, person.motion, person.gesture, person.present, person.bystander)


def _calm(person: Person) -> Person:
    """Somebody who sways and looks around, with hanging arms."""
    gesture = replace(person.gesture, move=lambda t, steps: np.zeros((len(t), 2, 3)))
    return replace(person, gesture=gesture)


@dataclass(frozen=True)
class _Case:
    scene: Scene
    about: str
    change: Callable[[Person], Person] | None = None  # of all people


_STANDING = replace(SCENES["noisy-4p5v"], activities=("stand",) * 4)
CASES = {
    "walkers": _Case(SCENES["unsync-5v"], "one runs, one walks, two wave; 1.5 px, phases, jitter .5 ms"),
    "mixed-rates": _Case(SCENES["mixed-rates"], "25 and 29.97 Hz, jitter 1 ms, lost frames"),
    "noisy": _Case(SCENES["noisy-4p5v"], "one walks, three on the spot; all faults of a detector"),
    "one-walker": _Case(replace(SCENES["unsync-5v"], activities=("walk",)), "one walks"),
    "gesturing": _Case(
        replace(SCENES["noisy-4p5v"], activities=("talk", "reach", "talk", "wave")),
        "four stand and gesture; all faults of a detector",
    ),
    "talking": _Case(
        replace(SCENES["noisy-4p5v"], activities=("talk",) * 4), "four stand and talk; all faults"
    ),
    "sitting": _Case(SCENES["sitting-group-6p5v"], "six round a table; faults that last for frames"),
    "ten-cameras": _Case(SCENES["noisy-8p10v"], "eight people, ten cameras; all faults"),
    "swaying": _Case(_STANDING, "four stand and sway; all faults", _calm),
    "resting": _Case(_STANDING, "nobody moves", _statue),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the bench."""
    parser.add_argument("--cases", default=",".join(CASES), help="names separated by commas")
    parser.add_argument("--seeds", default="0,1,2", help="numbers separated by commas")
    parser.add_argument("--frames", type=int, default=150, help="instants of each capture")
    parser.add_argument("--poses", action="store_true", help="also solve, for MPJPE before and after")
    parser.add_argument("--rig", type=Path, help="with --detections: a recording in place of simulated ones")
    parser.add_argument("--detections", type=Path, help="a recording, two of whose cameras are shifted")


def measure(args: argparse.Namespace, progress: Progress = untold) -> dict[str, Any]:
    """All cases: errors in s up to what all cameras share.

    Raises:
        UsageError: on unknown cases.
    """
    if (args.rig is None) != (args.detections is None):
        raise UsageError("--rig and --detections belong together")
    if args.detections is not None:
        return measure_shifts(args)
    names = args.cases.split(",")
    unknown = [name for name in names if name not in CASES]
    if unknown:
        raise UsageError(f"there is no case {unknown[0]!r}; there are {', '.join(CASES)}")
    seeds = [int(seed) for seed in args.seeds.split(",")]
    return {
        name: _summary([_take(CASES[name], seed, args.frames, args.poses) for seed in seeds])
        for name in each(names, len(names), progress, "captures")
    }


def lines(result: dict[str, Any]) -> list[str]:
    """The table."""
    if "shifts" in result:
        return shift_lines(result)
    head = "case          known   rms ms  worst ms  stated ms    z2   drift ppm      s"
    rows = [head + "   MPJPE mm: off, corrected, right"]
    for name, row in result.items():
        known = f"{row['known']}/{row['cameras']}"
        text = f"{name:<12} {known:>6} {1e3 * row['rms_s']:8.2f} {1e3 * row['worst_s']:9.2f}"
        text += f" {1e3 * row['stated_s']:10.2f} {row['z2']:5.2f} {1e6 * row['drift_rms']:11.0f}"
        text += f" {row['cpu_s']:6.1f}"
        if "mpjpe_m" in row:
            text += "   " + ", ".join(f"{1e3 * value:.2f}" for value in row["mpjpe_m"])
        rows.append(text)
    rows.append("of known offsets; z2: mean (error / stated deviation)^2, correlations allowed for")
    rows.append("s: CPU time per capture")
    return rows + [f"{name}: {CASES[name].about}" for name in result]


def _take(case: _Case, seed: int, frames: int, poses: bool) -> dict[str, Any]:
    """One capture with clocks that are off by constants and drifts; the first camera is right."""
    take = simulate(case.scene, seed, frames)
    if case.change is not None:
        take = replace(take, people=tuple(case.change(person) for person in take.people))
    context, configs = StageContext(take.rig, SKELETON), configure({})
    right = list(take.detection_sets())
    rng = np.random.default_rng([seed, 77])
    offsets, drifts = rng.uniform(-LARGEST, LARGEST, len(take.rig)), DRIFT * rng.normal(size=len(take.rig))
    offsets[0] = drifts[0] = 0.0
    middle = right[len(right) // 2].stamp_ns
    true = replace(CameraClocks.unknown(take.rig.names, middle), offsets=offsets, drifts=drifts)
    late = replace(true, offsets=-offsets, drifts=-drifts)
    wrong = regroup(right, late.corrections(right, every=True))
    start = time.process_time()
    found = find_clocks(wrong, context, configs, take.rig.names[0])
    spent = time.process_time() - start
    known = found.clocks.known.copy()
    error = (found.clocks.offsets - offsets)[known]
    others = np.flatnonzero(found.clocks.known[1:]) + 1
    root = np.linalg.cholesky(found.clocks.covariance[np.ix_(others, others)])
    outcome: dict[str, Any] = {
        "error": error - error.mean() if known[0] else error,
        "stated": found.clocks.deviations[others],
        "ratio": np.linalg.solve(root, (found.clocks.offsets - offsets)[others]),
        "drift": (found.clocks.drifts - drifts)[known],
        "known": int(known[1:].sum()),
        "cameras": len(known) - 1,
        "cpu": spent,
    }
    if poses:
        truth = sequence_of(take)
        right = regroup(wrong, true.corrections(wrong, every=True))  # without the frames that `wrong` lost
        outcome["mpjpe"] = [mpjpe_of(truth, sets, context, configs) for sets in (wrong, found.sets, right)]
    return outcome


def _summary(takes: Sequence[dict[str, Any]]) -> dict[str, Any]:
    def joined(key: str) -> Array:
        return np.concatenate([take[key] for take in takes])

    error, ratio = joined("error"), joined("ratio")
    row = {
        "known": sum(take["known"] for take in takes),
        "cameras": sum(take["cameras"] for take in takes),
        "rms_s": _rms(error),
        "worst_s": float(np.abs(error).max(initial=0.0)),
        "stated_s": _rms(joined("stated")),
        "z2": _rms(ratio) ** 2,
        "drift_rms": _rms(joined("drift")),
        "cpu_s": float(np.mean([take["cpu"] for take in takes])),
    }
    if "mpjpe" in takes[0]:
        row["mpjpe_m"] = np.mean([take["mpjpe"] for take in takes], axis=0).tolist()
    return row


def _rms(values: Array) -> float:
    return float(np.sqrt((values**2).mean())) if len(values) else float("nan")


def sequence_of(take: Simulation) -> SkeletonSequence:
    """The truth of a take."""
    frames = []
    for frame in take.truth_document()["frames"]:
        people = frame["skeletons"]
        ids = np.array([p["id"] for p in people], np.int64)
        positions = np.array([p["joints"] for p in people], float).reshape(-1, len(JOINTS), 3)
        ignored = np.array([p.get("ignore", False) for p in people], bool)
        frames.append(SkeletonFrame(frame["stamp_ns"], ids, positions, ignored=ignored))
    return SkeletonSequence(JOINTS, tuple(frames))


def mpjpe_of(
    truth: SkeletonSequence, sets: Sequence[DetectionSet], context: StageContext, configs: Any
) -> float:
    """Mean error (m) of refined skeletons."""
    results = records_of("skeletons", sets, configs, context)
    frames = [SkeletonFrame(r.stamp_ns, r.ids, r.positions) for r in results]
    pairs = pair_sequences(truth, SkeletonSequence(context.skeleton.joint_names, tuple(frames)), 0)
    return 1e-3 * report_of(pairs, truth.joint_names).joints.mpjpe_mm
