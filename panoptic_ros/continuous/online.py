"""Motion as a function of time while the views arrive: each instant from the views up to a lag later."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from panoptic_ros.continuous.bones import (
    LearntLengths,
    PairDistances,
    learn_lengths,
    pair_distances,
    relax,
)
from panoptic_ros.continuous.curves import CurveFit, KnotGrid, covariances_at
from panoptic_ros.continuous.follow import Entry, ViewTrack, ViewTracker
from panoptic_ros.continuous.problem import STEP_S, CurveProblem, LearntNoise, TrackRays
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.geometry.splines import control_points, spline
from panoptic_ros.solving.frames import CameraFrame

Array = np.ndarray
WINDOW_S = 0.8  # s of views from which an instant is computed
LEARNING_S = 1.6  # s of views from which noise, stiffness and lengths are learnt
LEARN_EVERY_S = 0.2
FIRST_ROUNDS, ROUNDS = 8, 2  # iterations of learning: at first, later
KEPT_DISTANCES = 500  # number of newest measurements of lengths that are kept
LEAST_DISTANCES = 25  # minimum number of measurements from which lengths are used
RELAXATIONS = 10  # iterations of conjugate gradients: 0.03 mm from the exact solution


@dataclass(eq=False)
class OnlinePerson:
    """Person who is followed online.

    Args:
        id: number of the person, from confirmation on.
        track: views and filters.
        learnt_at: (s) time of the newest learning.
        noise: what was learnt; None before the first learning.
        distances: newest measurements of the lengths.
        bones: learnt lengths; None before there are enough measurements.
    """

    id: int
    track: ViewTrack
    learnt_at: float = -np.inf
    noise: LearntNoise | None = None
    distances: PairDistances | None = None
    bones: LearntLengths | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PersonInstant:
    """One person at one instant.

    Args:
        id: the same number is the same person.
        positions, velocities: (J, 3) m and m/s, NaN = unknown joint.
        covariances: (J, 3, 3) m^2.
        last: (s) time of the newest view that shows the person.
    """

    id: int
    positions: Array
    velocities: Array
    covariances: Array
    last: float


@dataclass(eq=False)
class OnlineMotion:
    """Follows people through views in order of time, and gives their motion at recent instants.

    Args:
        arrays: cameras.
        mirror: (J,) joint on the other side of each joint.
        pairs: (P, 2) see `rigid_pairs`.
        pair_s: (s) see `follow.pairing_time`.
    """

    arrays: RigArrays
    mirror: Array
    pairs: Array
    pair_s: float
    people: list[OnlinePerson] = field(default_factory=list)
    frames: dict[int, tuple[CameraFrame, float]] = field(default_factory=dict)
    number: int = 0
    ids: int = 0

    def __post_init__(self) -> None:
        self.tracker = ViewTracker(self.arrays, self.mirror, self.pair_s)

    def take(self, frame: CameraFrame, time: float) -> None:
        """Take one view; times (s) must not decrease."""
        self.frames[self.number] = frame, time
        self.tracker.step(self.number, frame, time)
        self.number += 1
        while self.frames and next(iter(self.frames.values()))[1] < time - LEARNING_S:
            del self.frames[next(iter(self.frames))]
        self.tracker.ended.clear()
        known = {id(person.track): person for person in self.people}
        self.people = []
        for track in self.tracker.active:
            if not track.confirmed:
                continue
            person = known.get(id(track))
            if person is None:
                person = OnlinePerson(self.ids, track)
                self.ids += 1
            track.keep(self.frames)
            self.people.append(person)

    def at(self, time: float) -> list[PersonInstant]:
        """Return all people at a time (s) from the views that were taken."""
        found = []
        for person in self.people:
            if person.track.last - person.learnt_at >= LEARN_EVERY_S:
                self._learn(person)
            found.append(self._on_curve(person, time))
        return found

    def _rays(self, entries: list[Entry]) -> tuple[TrackRays, Array]:
        """Return the rays of views and their times (N,) s."""
        frames = [self.frames[entry.frame][0] for entry in entries]
        stamps = np.array([self.frames[entry.frame][1] for entry in entries])
        local = [entry._replace(frame=k) for k, entry in enumerate(entries)]
        rays = TrackRays.of(local, frames, stamps, self.arrays, self.mirror)
        return rays, rays.stamps

    def _problem(self, person: OnlinePerson, since: float, until: float = -np.inf) -> CurveProblem:
        """Return the problem of the views of the last `since` s, with a curve up to a time `until` (s)."""
        newest = person.track.last
        entries = [e for e in person.track.entries if self.frames[e.frame][1] >= newest - since]
        rays, times = self._rays(entries)
        origin, last = float(times.min()), max(float(times.max()), until)
        grid = KnotGrid(origin, STEP_S, control_points(origin, last + STEP_S, STEP_S))
        return CurveProblem(rays, times, self.arrays, grid, person.noise)

    def _learn(self, person: OnlinePerson) -> None:
        """Learn noise, stiffness and lengths from the newest views of a person."""
        problem = self._problem(person, LEARNING_S)
        fit = problem.solve(FIRST_ROUNDS if person.noise is None else ROUNDS)
        person.noise = problem.learnt
        new = pair_distances(problem, fit, self.pairs, max(person.learnt_at, float(problem.times.min())))
        if person.distances is not None:
            new = PairDistances(*(np.concatenate(both, axis=1) for both in zip(person.distances, new)))
        person.distances = PairDistances(*(part[:, -KEPT_DISTANCES:] for part in new))
        person.learnt_at = person.track.last
        if person.distances.lengths.shape[1] >= LEAST_DISTANCES:
            person.bones = learn_lengths(person.distances)

    def _on_curve(self, person: OnlinePerson, time: float) -> PersonInstant:
        problem = self._problem(person, WINDOW_S, time)
        for _ in range(2):  # robust weights, then the curves
            fit = problem.fit()
            problem.compare(fit)
        fit = problem.fit()
        points = fit.points
        if person.bones is not None:
            instants = np.arange(float(problem.times.min()), float(problem.times.max()), 0.02)
            points = points + relax(
                fit.factors, points, problem.grid, instants, self.pairs, person.bones, RELAXATIONS
            )
        return _instant(person, fit, points, problem.grid, time)


def _instant(
    person: OnlinePerson, fit: CurveFit, points: Array, grid: KnotGrid, time: float
) -> PersonInstant:
    curve = spline(grid.origin, grid.step, points.transpose(1, 0, 2))
    covariances = covariances_at(fit.inverses, grid, np.array([time]))[:, 0]
    return PersonInstant(person.id, curve(time), curve(time, 1), covariances, person.track.last)
