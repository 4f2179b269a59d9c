"""Motion of all people as a function of time, and its values at any instants."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from panoptic_ros.continuous.clocks import CameraTimes
from panoptic_ros.continuous.person import PersonCurve
from panoptic_ros.domain import JointState, RefinedPoseSet
from panoptic_ros.errors import UsageError
from panoptic_ros.stage import Notice

Array = np.ndarray
ABSENT_S = 0.5  # s without a view after which a person is not reported
MOST_SIGMA = 0.2  # m per axis, greatest standard deviation (RMS) of a joint that is reported
MOST_INSTANTS = 20_000_000  # 55 hours at 100 Hz
PART = 1000  # number of instants that are evaluated at once


@dataclass(frozen=True, slots=True, eq=False)
class ContinuousMotion:
    """Result of the pass.

    Args:
        people: curves of all people.
        reference_ns: origin of the times of the curves.
        first_ns, last_ns: first and last corrected timestamp of a view.
        period: (s) typical time between two frames of a camera.
        cameras: (C) names.
        clocks: (C) clocks and line delays, with `reference_ns`.
        skeleton_hash: skeleton of the joints.
        derived: joints that are means of others, see `SkeletonModel`.
        notices: faults of the recording.
    """

    people: tuple[PersonCurve, ...]
    reference_ns: int
    first_ns: int
    last_ns: int
    period: float
    cameras: tuple[str, ...]
    clocks: CameraTimes
    skeleton_hash: str
    derived: tuple[tuple[int, tuple[int, ...]], ...] = ()
    notices: tuple[Notice, ...] = ()

    def at_rate(self, rate: float) -> Array:
        """Return the instants (T,) ns k / rate after the first view, up to the last view.

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
        return instants

    def sets(self, stamps_ns: Sequence[int] | Array) -> Iterator[RefinedPoseSet]:
        """Yield the people at increasing instants (T,) ns."""
        stamps = iter(int(stamp) for stamp in stamps_ns)
        support = [ViewSupport(person) for person in self.people]
        index = 0
        while part := list(islice(stamps, PART)):
            times = 1e-9 * (np.array(part, np.int64) - self.reference_ns)
            people = [self._person(person, times, own) for person, own in zip(self.people, support)]
            for k, stamp in enumerate(part):
                rows = [values for here, values in people if here[k]]
                columns = [[values[c][k] for values in rows] for c in range(5)]
                positions, covariances, scores, views, states = columns
                yield self._set(
                    index,
                    stamp,
                    [person.id for person, (here, _) in zip(self.people, people) if here[k]],
                    (positions, covariances, scores, views, states),
                )
                index += 1

    def _set(
        self, index: int, stamp_ns: int, ids: list[int], columns: tuple[list[Array], ...]
    ) -> RefinedPoseSet:
        joints = self.people[0].points.shape[1] if self.people else 0
        shapes = ((joints, 3), (joints, 3, 3), (joints,), (joints,), (joints,))
        arrays = [np.stack(rows) if rows else np.empty((0, *shape)) for rows, shape in zip(columns, shapes)]
        positions, covariances, scores, views, states = arrays
        return RefinedPoseSet(
            index,
            stamp_ns,
            self.skeleton_hash,
            positions,
            covariances,
            scores,
            views,
            states,
            scores.mean(axis=1) if len(ids) else np.empty(0),
            ids=np.array(ids, np.int64),
        )

    def _person(
        self, person: PersonCurve, times: Array, support: ViewSupport
    ) -> tuple[Array, tuple[Array, ...]]:
        """Return when a person is reported (T,), and positions, covariances, scores, views and states."""
        since = times - person.seen[np.maximum(np.searchsorted(person.seen, times, "right") - 1, 0)]
        here = (since >= 0.0) & (since <= ABSENT_S) & (times < person.until)
        if not here.any():
            return here, ()
        positions = person.at(times)
        covariances = person.covariances_at(times)
        scores, views, later = support.at(times, self.period)
        for joint, sources in self.derived:
            own = list(sources)
            scores[:, joint], views[:, joint] = scores[:, own].min(axis=1), views[:, own].min(axis=1)
            later[:, joint] = later[:, own].all(axis=1)
        states = np.where(
            views > 0, JointState.MEASURED, np.where(later, JointState.FILLED, JointState.PREDICTED)
        ).astype(np.uint8)
        sigma = np.sqrt(np.trace(covariances, axis1=-2, axis2=-1) / 3.0)
        missing = ~(sigma <= MOST_SIGMA) | ~np.isfinite(positions).all(axis=-1)
        scores = np.where(views > 0, np.clip(scores, 0.01, 1.0), 0.1)
        states[missing], scores[missing], views[missing] = JointState.MISSING, 0.0, 0
        positions[missing], covariances[missing] = np.nan, np.nan
        here &= ~missing.all(axis=1)
        return here, (positions, covariances, scores, views, states)


class ViewSupport:
    """Views that show the joints of a person, sorted once for all instants.

    Args:
        person: curves with their rays.
    """

    def __init__(self, person: PersonCurve):
        self._joints: list[tuple[Array, Array, list[Array]]] = []  # times, sums of weights, times by camera
        for j in range(person.points.shape[1]):
            own = slice(person.rays.starts[j], person.rays.starts[j + 1])
            order = np.argsort(person.times[own], kind="stable")
            times, cameras = person.times[own][order], person.rays.cameras[own][order]
            weights = (person.trusts[own] * person.rays.scores[own])[order]
            total = np.concatenate([[0.0], np.cumsum(weights)])
            self._joints.append((times, total, [times[cameras == c] for c in np.unique(cameras)]))

    def at(self, times: Array, period: float) -> tuple[Array, Array, Array]:
        """Return mean scores (T, J), numbers of cameras (T, J) and whether later views follow (T, J).

        Args:
            times: (T,) s.
            period: (s) reach before and after an instant.
        """
        shape = len(times), len(self._joints)
        scores, views, later = np.zeros(shape), np.zeros(shape, np.int64), np.zeros(shape, bool)
        for j, (own, total, of_cameras) in enumerate(self._joints):
            low = np.searchsorted(own, times - period)
            high = np.searchsorted(own, times + period, "right")
            later[:, j] = high < len(own)
            scores[:, j] = (total[high] - total[low]) / np.maximum(high - low, 1)
            for mine in of_cameras:
                last = np.searchsorted(mine, times + period, "right")
                views[:, j] += last > np.searchsorted(mine, times - period)
        return scores, views, later
