"""What solving for a body costs on a simulated capture, in processor time of one thread."""

from __future__ import annotations

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
from panoptic_ros.kinematics.pose.targets import Evidence, no_anchor
from panoptic_ros.running.simulations.body_scenes import body_scene
from panoptic_ros.running.studies.bodies.cases import prior_without
from panoptic_ros.running.studies.bodies.following import follow, tracker_of
from panoptic_ros.simulation.bodies.capture import BodyCapture, simulate_body, sparse

Array = np.ndarray
SCENE = "body-punch"
WARM = 30  # instants that are not timed


def body_costs(
    seconds: float, seed: int, kinds: tuple[tuple[int, int], ...], lags: tuple[float, ...]
) -> Iterator[dict[str, Any]]:
    """Milliseconds per solve and per instant, for each number of cameras and IMUs."""
    model, clips = read_body_model(), read_clips()
    scene = replace(body_scene(SCENE), seconds=seconds)
    capture = simulate_body(scene, seed, model, clips)
    statistics = prior_without(scene.clips, clips, model)
    for cameras, imus in kinds:
        part = sparse(capture, range(cameras), imus)
        alone = KinematicsConfig(window=False, iterations=20, mounting=False)
        row = {"cameras": cameras, "imus": imus} | _solves(part, alone, statistics)
        for lag in lags:
            times = _steps(part, KinematicsConfig(lag=lag), statistics)[WARM:]
            row |= {f"lag_{lag:g}_ms": float(np.median(times)), f"lag_{lag:g}_mean_ms": float(times.mean())}
        yield row


class _Asked(SubjectTracker):
    """Keeps what is solved, and from which pose."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self.asked: list[tuple[Pose, Evidence]] = []

    def _step_alone(self, evidence: Evidence, period: float) -> None:
        assert self._pose is not None
        self.asked.append((self._pose.copy(), evidence))
        super()._step_alone(evidence, period)


def _steps(capture: BodyCapture, config: KinematicsConfig, statistics: PoseStatistics) -> Array:
    """Milliseconds (T,) of all that is done per instant."""
    times = [time.thread_time()]
    for _ in follow(*tracker_of(capture, config, statistics), config.gate):
        times.append(time.thread_time())
    return 1e3 * np.diff(times)


def _solves(capture: BodyCapture, config: KinematicsConfig, statistics: PoseStatistics) -> dict[str, float]:
    """Milliseconds of a solve alone, from the pose of the instant before, and its iterations."""
    tracker, instants = tracker_of(capture, config, statistics, _Asked)
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
