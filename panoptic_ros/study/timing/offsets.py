"""The study `offsets`: clock offsets from motion.

It reports errors, stated deviations and the effect on 3D poses.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from panoptic_ros.domain import DetectionSet
from panoptic_ros.evaluation import SkeletonFrame, SkeletonSequence, pair_sequences
from panoptic_ros.evaluation.report import report_of
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.clocks_from_motion import find_clocks
from panoptic_ros.graph.pipeline import records_of
from panoptic_ros.offsets.clocks import CameraClocks
from panoptic_ros.offsets.regroup import regroup
from panoptic_ros.running.arguments import within
from panoptic_ros.simulation import Simulation, simulate
from panoptic_ros.simulation.people import SimulatedPerson
from panoptic_ros.simulation.scenes import SCENES, SimulatedScene
from panoptic_ros.simulation.skeleton import JOINTS, SKELETON
from panoptic_ros.stage import Progress, StageContext, each
from panoptic_ros.study.options import add_seeds, known_names, words
from panoptic_ros.study.study import Case, Column, Result, Row, Study

Array = np.ndarray
LARGEST = 0.06  # s, limit of the injected offsets
DRIFT = 5e-5  # standard deviation of the injected drifts, s/s
POSES = ("off", "corrected", "right")  # timestamps used for solving: wrong, corrected, true


class _Statue(SimulatedPerson):
    """Person without any motion."""

    def posture(self, t: Array) -> Any:
        return super().posture(np.zeros_like(t))


def _statue(person: SimulatedPerson) -> SimulatedPerson:
    return _Statue(person.id, person.body, person.motion, person.gesture, person.present, person.bystander)


def _calm(person: SimulatedPerson) -> SimulatedPerson:
    """Return the person with hanging arms; only sway and head motion remain."""
    gesture = replace(person.gesture, move=lambda t, steps: np.zeros((len(t), 2, 3)))
    return replace(person, gesture=gesture)


@dataclass(frozen=True)
class _Case:
    scene: SimulatedScene
    about: str
    change: Callable[[SimulatedPerson], SimulatedPerson] | None = None  # applies to every person


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
    "sitting": _Case(SCENES["sitting-group-6p5v"], "six round a table; faults that persist for frames"),
    "ten-cameras": _Case(SCENES["noisy-8p10v"], "eight people, ten cameras; all faults"),
    "swaying": _Case(_STANDING, "four stand and sway; all faults", _calm),
    "resting": _Case(_STANDING, "no person moves", _statue),
}


class Offsets(Study):
    """Clocks from motion in simulated captures: errors in s up to the part that all cameras share.

    The mean error of the cameras is subtracted if the clock of the first camera is known.
    """

    columns = (
        Column("case", "case"),
        Column("known", "known"),
        Column("cameras", "of"),
        Column("rms_s", "rms ms", ".2f", 1e3),
        Column("worst_s", "worst ms", ".2f", 1e3),
        Column("stated_s", "stated ms", ".2f", 1e3),
        Column("z2", "z2", ".2f"),
        Column("drift_rms", "drift ppm", ".0f", 1e6),
        Column("cpu_s", "CPU s", ".1f"),
        *(Column(f"mpjpe_{name}_m", f"MPJPE mm {name}", ".2f", 1e3) for name in POSES),
    )

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        parser.add_argument(
            "--cases", type=words, default=list(CASES), metavar="NAME,NAME", help="cases; default all"
        )
        add_seeds(parser, "0:3")
        parser.add_argument(
            "--frames",
            type=within(int, 10, 10**6),
            default=150,
            metavar="N",
            help="frames per case; default 150",
        )
        parser.add_argument(
            "--poses",
            action="store_true",
            help="also solve skeletons, for their MPJPE before and after correction",
        )

    def cases(self) -> list[Case]:
        """See `Study`."""
        return [Case(name, name) for name in known_names(self.options.cases, CASES, "case")]

    def measure(self, case: Case, progress: Progress) -> list[Row]:
        """See `Study`."""
        seeds, given = self.options.seeds, self.options
        told = each(seeds, len(seeds), progress, "captures")
        takes = [_take(CASES[case.request], seed, given.frames, given.poses) for seed in told]
        return [{"case": case.title} | _summary(takes)]

    def lines(self, result: Result) -> Iterator[str]:
        """See `Study`."""
        yield from super().lines(result)
        yield "of known offsets; z2: mean (error / stated deviation)^2, correlations allowed for"
        yield from (f"{row['case']}: {CASES[row['case']].about}" for row in result["rows"])


def _take(case: _Case, seed: int, frames: int, poses: bool) -> dict[str, Any]:
    """Find the clocks of one capture with injected offsets and drifts; the first camera has none."""
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
    row: Row = {
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
        means = np.mean([take["mpjpe"] for take in takes], axis=0).tolist()
        row |= {f"mpjpe_{name}_m": value for name, value in zip(POSES, means)}
    return row


def _rms(values: Array) -> float:
    return float(np.sqrt((values**2).mean())) if len(values) else float("nan")


def sequence_of(take: Simulation) -> SkeletonSequence:
    """Return the true skeletons of a take."""
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
    """Return the mean joint error (m) of refined skeletons."""
    results = records_of("skeletons", sets, configs, context)
    frames = [SkeletonFrame(r.stamp_ns, r.ids, r.positions) for r in results]
    pairs = pair_sequences(truth, SkeletonSequence(context.skeleton.joint_names, tuple(frames)), 0)
    return 1e-3 * report_of(pairs, truth.joint_names).joints.mpjpe_mm
