"""Bodies in the live graph, fed with 2D poses and IMU samples: latency and processor time."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rclpy.serialization import deserialize_message

from panoptic_ros.domain import BodySource
from panoptic_ros.graph.flow import make_flow
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.files import write_json
from panoptic_ros.io.kinematic_files import subject_document
from panoptic_ros.io.messages import stamp_of, to_message
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.nodes.middleware.family import message_class, ros_messages
from panoptic_ros.nodes.middleware.quality import collecting_quality, data_quality
from panoptic_ros.params import config_of
from panoptic_ros.running.plans.designated import with_subjects
from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.running.processes.children import Processes
from panoptic_ros.running.processes.usage import Usage, usage_of
from panoptic_ros.study.bodies.body_feed import BodyFeed
from panoptic_ros.study.live.player import LAST_WORDS_S, Player, played

Array = np.ndarray
DROPPED = "dropped."
FOUND_S = 20.0  # s from the first skeletons; the graph estimates the clocks of IMUs in the first 15 s


def run_fed_bodies(feed: BodyFeed, seconds: float, lag: float) -> dict[str, Any]:
    """Run the graph and return latencies and processor time.

    Latencies (ms) are from the timestamps of bodies to their arrival in this process. Processor time is in %
    of a core, by process.

    Args:
        seconds: measured time (s).
        lag: `kinematics.lag`, s.

    Raises:
        UserError: with the output of a node that ended.
        EnvironmentProblem: if another graph runs in this ROS domain, or no skeletons arrive.
    """
    found: dict[str, Any] = played(feed, False, lambda: _BodyPlayer(feed, seconds), _with_bodies(feed, lag))
    return found


def _with_bodies(feed: BodyFeed, lag: float) -> Callable[[Plan, Path], Plan]:
    def change(plan: Plan, folder: Path) -> Plan:
        files = [folder / f"subject{subject.id}.json" for subject in feed.subjects]
        for path, subject in zip(files, feed.subjects):
            write_json(path, subject_document(subject))
        bodies = replace(config_of(plan.configs, KinematicsConfig), lag=lag)
        return with_subjects(replace(plan, configs={**plan.configs, "kinematics": bodies}), files)

    return change


class _ProcessUsage(NamedTuple):
    """Resource usage of the processes at a time, and the drop counts of the kinematics node by cause."""

    usage: dict[str, Usage]
    dropped: Counter[str]


class _BodyPlayer(Player):
    """Player that also publishes IMU samples and receives bodies."""

    def __init__(self, feed: BodyFeed, seconds: float):
        super().__init__(feed, revived=False)
        self._seconds = seconds
        self._bodies: list[tuple[int, int, int]] = []  # timestamp, arrival time, bodies solved from data
        live, imu, bodies = make_flow("live"), TOPICS["imu"], TOPICS["bodies"]
        kind = message_class(imu.message)
        self._imus = {
            name: self.node.create_publisher(kind, imu.of(name), data_quality(live, sound=True))
            for name in feed.devices
        }
        self._kind = message_class(bodies.message)
        self._kept = self.node.create_subscription(
            self._kind, bodies.name, self._take_bodies, collecting_quality(live), raw=True
        )
        family, count = ros_messages(), 2 * (len(feed.sets) - 1)
        samples = [
            [(offset, to_message(sample, family)) for offset, sample in feed.samples(number)]
            for number in range(count)
        ]
        self._all = [
            sorted([*super(_BodyPlayer, self).messages(number), *samples[number]], key=lambda row: row[0])
            for number in range(count)
        ]

    def messages(self, number: int) -> list[tuple[int, Any]]:
        """See `Player`."""
        return self._all[number % len(self._all)]

    def publish(self, message: Any, stamp_ns: int) -> None:
        """See `Player`."""
        device = self._imus.get(message.header.frame_id)
        if device is None:
            super().publish(message, stamp_ns)
        else:
            message.header.stamp = ros_messages().header(stamp_ns, "").stamp
            device.publish(message)

    def _take_bodies(self, data: bytes) -> None:
        when = time.monotonic_ns()
        message = deserialize_message(data, self._kind)
        known = sum(body.source != BodySource.PREDICTED for body in message.bodies)
        self._bodies.append((stamp_of(message.header), when, known))

    def do(self, processes: Processes) -> dict[str, Any]:
        """See `Player`."""
        while not self.is_settled():
            self.play()
        self.play_until(self.received[0][1] + round(1e9 * FOUND_S))
        before, end = self._used(processes), time.monotonic_ns() + round(1e9 * self._seconds)
        while time.monotonic_ns() < end:
            self.play()
            if self.number % 15 == 0:
                processes.check()
        after = self._used(processes)
        self.spin_until(time.monotonic_ns() + round(1e9 * LAST_WORDS_S))
        return self._figures(before, after)

    def _used(self, processes: Processes) -> _ProcessUsage:
        told = self.node.diagnostics.get("kinematics", {})
        counts = {key.removeprefix(DROPPED): int(n) for key, n in told.items() if key.startswith(DROPPED)}
        dropped = Counter(counts)
        return _ProcessUsage(
            {name: usage_of([pid]) for name, pid in zip(processes.names, processes.ids)}, dropped
        )

    def _figures(self, before: _ProcessUsage, after: _ProcessUsage) -> dict[str, Any]:
        begin, end = (next(iter(used.usage.values())).at_ns for used in (before, after))
        passed = 1e-9 * (end - begin)
        rows = [row for row in self._bodies if begin <= row[1] <= end]
        late = np.array([1e-6 * (when - stamp + self.stamps_from) for stamp, when, _ in rows])
        skeletons = [1e-6 * (w - s + self.stamps_from) for s, w in self.received if begin <= w <= end]
        return {
            "instants_hz": len(rows) / passed,
            "bodies": float(np.mean([known for *_, known in rows])) if rows else 0.0,
            **{f"latency_p{share}_ms": _percentile(late, share) for share in (50, 90, 99, 100)},
            "skeletons_p50_ms": _percentile(np.array(skeletons), 50),
            "cpu_percent": {
                name: 100.0 * (after.usage[name].cpu_s - usage.cpu_s) / passed
                for name, usage in before.usage.items()
            },
            "dropped_hz": {cause: n / passed for cause, n in (after.dropped - before.dropped).items()},
        }


def _percentile(values: Array, share: float) -> float | None:
    """Return a percentile; None without values, because JSON has no NaN."""
    return float(np.percentile(values, share)) if len(values) else None
