"""The studies `kinematics-time` and `kinematics-live`: processor time of bodies, alone and in the graph."""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from panoptic_ros.geometry.chain import Pose
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.recorded_motions import read_clips
from panoptic_ros.kinematics.body.tracker import SubjectTracker
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.pose.prior import PoseStatistics
from panoptic_ros.kinematics.pose.solve import solve_pose
from panoptic_ros.kinematics.pose.targets import PoseEvidence, no_anchor
from panoptic_ros.running.arguments import within
from panoptic_ros.running.simulations.body_scenes import body_scene
from panoptic_ros.simulation.bodies.capture import BodyCapture, simulate_body, sparse
from panoptic_ros.stage import Progress
from panoptic_ros.study.bodies.body_feed import body_feed
from panoptic_ros.study.bodies.cases import prior_without
from panoptic_ros.study.bodies.following import follow, tracker_of
from panoptic_ros.study.options import add_seeds
from panoptic_ros.study.study import Case, Column, Result, Row, Study

Array = np.ndarray
SCENE = "body-punch"
WARM = 30  # warm-up time steps that are not timed
KINDS = ((8, 13), (4, 13), (4, 6), (1, 13), (8, 0), (0, 13))
LAGS = (0.0, 0.1)
SUBJECTS, RATE = 4, 60.0
MOST_LIVE, RATES = 8, (20, 30, 60)
LATE = "late"  # drop cause of time steps that the stage skipped to catch up
BACK_S = 8.0  # s, duration of the live motion before it is played backward


class KinematicsTime(Study):
    """Milliseconds per solve and per instant of a simulated capture, for mixes of cameras and IMUs."""

    columns = (
        Column("cameras", "cameras"),
        Column("imus", "IMUs"),
        Column("solve_ms", "per solve", ".3f"),
        Column("iterations", "iterations", ".1f"),
        *(
            Column(f"lag_{lag:g}_{key}", f"lag {lag:g} s{text}", ".2f")
            for lag in LAGS
            for key, text in (("ms", ""), ("mean_ms", " (mean)"))
        ),
    )

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        parser.add_argument(
            "--seconds",
            type=within(float, 2.0, 20.0),
            default=6.0,
            metavar="S",
            help="length of the simulated capture; default 6",
        )
        add_seeds(parser, "1")

    def cases(self) -> list[Case]:
        """See `Study`."""
        return [
            Case(f"{c} cameras, {i} IMUs, seed {s}", (c, i, s)) for s in self.options.seeds for c, i in KINDS
        ]

    def measure(self, case: Case, progress: Progress) -> list[Row]:
        """See `Study`."""
        cameras, imus, seed = case.request
        model, clips = read_body_model(), read_clips()
        scene = replace(body_scene(SCENE), seconds=self.options.seconds)
        capture = simulate_body(scene, seed, model, clips)
        statistics = prior_without(scene.clips, clips, model)
        part = sparse(capture, range(cameras), imus)
        alone = KinematicsConfig(window=False, iterations=20, mounting=False)
        row: Row = {"cameras": cameras, "imus": imus} | _solves(part, alone, statistics)
        for lag in LAGS:
            times = _steps(part, KinematicsConfig(lag=lag), statistics)[WARM:]
            row |= {f"lag_{lag:g}_ms": float(np.median(times)), f"lag_{lag:g}_mean_ms": float(times.mean())}
        return [row]

    def summary(self, rows: list[Row]) -> dict[str, Any]:
        """See `Study`."""
        worst = max(row[f"lag_{LAGS[-1]:g}_mean_ms"] for row in rows)
        return {"share_of_core": 1e-3 * SUBJECTS * RATE * worst}

    def head(self, result: Result) -> str:
        """See `Study`."""
        return "processor time, ms: median (mean) per instant"

    def lines(self, result: Result) -> Iterator[str]:
        """See `Study`."""
        yield from super().lines(result)
        share = 100.0 * result["share_of_core"]
        yield (f"{SUBJECTS} subjects at {RATE:g} Hz, lag {LAGS[-1]:g} s, at most {share:.0f} % of a core")


class KinematicsLive(Study):
    """Subjects with 13 IMUs each before 8 cameras in the live graph: latency, and all of the nodes' work."""

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        parser.add_argument(
            "--subjects",
            type=within(int, 1, MOST_LIVE),
            default=SUBJECTS,
            metavar="N",
            help=f"number of subjects; default {SUBJECTS}",
        )
        parser.add_argument(
            "--rate", type=int, choices=RATES, default=30, help="rate of the cameras; default 30"
        )
        parser.add_argument(
            "--lag",
            type=within(float, 0.0, 0.2),
            default=0.1,
            metavar="S",
            help="lag of the bodies; default 0.1",
        )
        parser.add_argument(
            "--seconds",
            type=within(float, 1.0, 3600.0),
            default=6.0,
            metavar="S",
            help="measured time, after the graph has settled; default 6",
        )
        add_seeds(parser, "1")

    def measure(self, case: Case, progress: Progress) -> list[Row]:
        """See `Study`."""
        from panoptic_ros.study.bodies.fed_bodies import run_fed_bodies  # needs ROS

        given = self.options
        feed = body_feed(
            given.subjects, given.rate, BACK_S, given.seeds.start, read_body_model(), read_clips()
        )
        return [
            {
                "source": feed.title,
                "views": len(feed.rig),
                "rate_hz": feed.rate,
                "lag_s": given.lag,
                "load": os.getloadavg()[0],
                **run_fed_bodies(feed, given.seconds, given.lag),
            }
        ]

    def lines(self, result: Result) -> Iterator[str]:
        """See `Study`."""
        (result,) = result["rows"]
        yield (
            f"{result['source']}, {result['views']} cameras at {result['rate_hz']:g} Hz, "
            f"lag {result['lag_s']:g} s; load {result['load']:.1f} before"
        )
        lost = {cause: rate for cause, rate in result["dropped_hz"].items() if cause != LATE}
        causes = f" ({', '.join(f'{rate:.1f} {cause}' for cause, rate in lost.items())})" if lost else ""
        yield (
            f"{result['instants_hz']:.1f} instants/s with {result['bodies']:.2f} bodies solved from data; "
            f"{result['dropped_hz'].get(LATE, 0.0):.1f} instants/s left out as late; "
            f"{sum(lost.values()):.1f} messages/s dropped{causes}"
        )
        late = ", ".join(f"{_ms(result[f'latency_p{share}_ms'])} (p{share})" for share in (50, 90, 99, 100))
        least = 1e3 * (result["lag_s"] + 1.0 / result["rate_hz"])
        yield f"from an instant to its bodies, ms: {late}; lag and a camera's period are {least:.0f}"
        yield f"from a set of views to its skeletons, ms: {_ms(result['skeletons_p50_ms'])} (p50)"
        used = ", ".join(f"{name} {share:.0f}" for name, share in result["cpu_percent"].items())
        yield f"processor time by process, % of a core: {used}"


def _ms(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


class _RecordingTracker(SubjectTracker):
    """Tracker that stores the initial pose and the evidence of every solve."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self.asked: list[tuple[Pose, PoseEvidence]] = []

    def _step_alone(self, evidence: PoseEvidence, period: float) -> None:
        assert self._pose is not None
        self.asked.append((self._pose.copy(), evidence))
        super()._step_alone(evidence, period)


def _steps(capture: BodyCapture, config: KinematicsConfig, statistics: PoseStatistics) -> Array:
    """Return the processor time (T,) ms of everything that a time step needs."""
    times = [time.thread_time()]
    for _ in follow(*tracker_of(capture, config, statistics), config.gate):
        times.append(time.thread_time())
    return 1e3 * np.diff(times)


def _solves(capture: BodyCapture, config: KinematicsConfig, statistics: PoseStatistics) -> dict[str, float]:
    """Return the median time (ms) of a solve alone, and its mean number of iterations.

    Each solve starts from the pose of the previous time step.
    """
    tracker, instants = tracker_of(capture, config, statistics, _RecordingTracker)
    for _ in follow(tracker, instants, config.gate):
        pass
    chain, times, iterations = capture.subject.body.chain, [], []
    hessian = np.empty((3 + 3 * len(chain.parents),) * 2)
    nothing = no_anchor(len(chain.parents))
    for pose, evidence in tracker.asked[WARM:]:
        began = time.thread_time()
        _, done = solve_pose(chain, pose, evidence, nothing, config.iterations, hessian)
        times.append(1e3 * (time.thread_time() - began))
        iterations.append(done)
    return {"solve_ms": float(np.median(times)), "iterations": float(np.mean(iterations))}
