"""Motion of all people as a function of time, and its values at any instants."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from panoptic_ros.continuous.clocks import CameraTimes
from panoptic_ros.continuous.person import PersonCurve
from panoptic_ros.continuous.reports import (
    JointReport,
    RayEvidence,
    add_biases,
    add_calibration,
    joint_report,
    pose_set,
    was_seen,
)
from panoptic_ros.domain import JointState, RefinedPoseSet
from panoptic_ros.errors import UsageError
from panoptic_ros.solving.calibration_errors import CalibrationErrors
from panoptic_ros.stage import Notice

Array = np.ndarray
MOST_INSTANTS = 20_000_000  # 55 hours at 100 Hz
PART = 1000  # number of instants that are evaluated at once


@dataclass(frozen=True, slots=True, eq=False)
class ContinuousMotion:
    """Result of the pass.

    Args:
        people: Curves of all people.
        reference_ns: Origin of the times of the curves.
        first_ns, last_ns: First and last corrected timestamp of a view.
        period: (s) typical time between two frames of a camera.
        cameras: (C) names.
        clocks: (C) clocks and line delays, with `reference_ns`.
        skeleton_hash: Skeleton of the joints.
        joints: Number of joints.
        derived: Joints that are means of others, see `SkeletonModel`.
        notices: Faults of the recording.
        calibration: Errors of the rig's calibration; None = unknown.
        bias_floors: see `SkeletonModel`.
    """

    people: tuple[PersonCurve, ...]
    reference_ns: int
    first_ns: int
    last_ns: int
    period: float
    cameras: tuple[str, ...]
    clocks: CameraTimes
    skeleton_hash: str
    joints: int
    derived: tuple[tuple[int, tuple[int, ...]], ...] = ()
    notices: tuple[Notice, ...] = ()
    calibration: CalibrationErrors | None = None
    bias_floors: tuple[float, ...] = ()

    def at_rate(self, rate: float) -> Array:
        """Return the instants (T,) ns k / rate after the first view, up to the last view.

        Instants before time 0 are left out, because no timestamp states them. Correction of the first
        timestamps can cause them.

        Raises:
            UsageError: if there are more than `MOST_INSTANTS`.
        """
        seconds = (self.last_ns - self.first_ns) * 1e-9
        count = int(seconds * rate + 1e-6) + 1
        if count > MOST_INSTANTS:
            raise UsageError(
                f"a rate of {rate:g} Hz over {seconds:.0f} s gives {count} instants, more than "
                f"{MOST_INSTANTS}; give a lower rate"
            )
        instants: Array = self.first_ns + np.round(np.arange(count) * (1e9 / rate)).astype(np.int64)
        return instants[instants >= 0]

    def sets(self, stamps_ns: Sequence[int] | Array) -> Iterator[RefinedPoseSet]:
        """Yield the people at increasing instants (T,) ns."""
        evidence = [_evidence(person) for person in self.people]
        stamps = iter(int(stamp) for stamp in stamps_ns)
        index = 0
        while part := list(islice(stamps, PART)):
            times = 1e-9 * (np.array(part, np.int64) - self.reference_ns)
            people = [self._person(person, rays, times) for person, rays in zip(self.people, evidence)]
            for k, stamp in enumerate(part):
                shown = [
                    (person.id, report.at(k))
                    for person, (here, report) in zip(self.people, people)
                    if here[k]
                ]
                yield pose_set(index, stamp, self.skeleton_hash, self.joints, shown)
                index += 1

    def _person(self, person: PersonCurve, evidence: RayEvidence, times: Array) -> tuple[Array, JointReport]:
        """Return when a person is reported (T,), and its joints."""
        positions, covariances = person.at(times), person.covariances_at(times)
        report = joint_report(times, positions, covariances, evidence, self.period, self.derived)
        add_calibration(report, times, evidence, self.period, self.derived, self.calibration)
        add_biases(report, self.bias_floors)
        here = was_seen(times, person.seen) & (times < person.until)
        return here & (report.states != JointState.MISSING).any(axis=1), report


def _evidence(person: PersonCurve) -> RayEvidence:
    rays = person.rays
    return RayEvidence.of(rays.starts, person.times, rays.cameras, person.trusts * rays.scores)
