"""Motion as a function of time while the views arrive: each instant from the views up to a lag later."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from panoptic_ros.continuous.bones import LearntLengths, PairDistances, learn_lengths, pair_distances
from panoptic_ros.continuous.curves import ORDER, KnotGrid
from panoptic_ros.continuous.follow import ViewTrack, ViewTracker, pairing_time_of
from panoptic_ros.continuous.instant import CameraRows, InstantFit, fit_instant, window_rays
from panoptic_ros.continuous.problem import (
    CAUCHY,
    FIRST_NOISE,
    LEAST_DEPTH,
    MEMORY_S,
    STEP_S,
    CurveProblem,
    LearntNoise,
    TrackRays,
)
from panoptic_ros.continuous.reports import JointReport, RayEvidence, joint_report, was_seen
from panoptic_ros.continuous.seen_views import SeenViews
from panoptic_ros.domain import JointState
from panoptic_ros.domain.of_all import joined, selected
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.geometry.splines import control_points
from panoptic_ros.solving.frames import CameraFrame
from panoptic_ros.solving.joint_noise import JointNoiseModel

Array = np.ndarray
WINDOW_S = 0.5  # s of views from which an instant is computed, half of them later where they exist
# s of views that are kept, and number of newest views from which noise, stiffness and lengths are learnt
LEARNING_S, LEARNING_VIEWS = 1.6, 200
LEARN_EVERY_S = 0.15  # s between two times of learning
# iterations of learning: of a new person, while a person has fewer views than LEARNING_S, and later
FIRST_ROUNDS, EARLY_ROUNDS, ROUNDS = 8, 3, 1
KEPT_DISTANCES = 500  # number of newest measurements of lengths that are kept
LEAST_DISTANCES = 25  # minimum number of measurements from which lengths are used
KEPT_STEPS = 9  # number of newest times between frames whose median is the period of a camera
LONGEST_STEP_S = 1.0  # s; a longer time between frames is a pause
USUAL_PERIOD_S = 0.1  # s, period before any camera has given two frames
NO_PAIRS = np.zeros((0, 2), np.int64)
NO_LENGTHS = LearntLengths(np.zeros(0), np.zeros(0))


class PersonInstant(NamedTuple):
    """One person at one instant.

    Args:
        id: the same number is the same person.
        report: joints, each array without the axis of instants.
        velocities: (J, 3) m/s, also of missing joints.
    """

    id: int
    report: JointReport
    velocities: Array


class CameraPeriods:
    """Times between the frames of each camera, from the newest ones."""

    def __init__(self) -> None:
        self._last: dict[int, float] = {}  # s, by camera
        self._steps: dict[int, deque[float]] = {}  # s, by camera
        self._periods: dict[int, float] = {}  # s, by camera: their median

    def take(self, camera: int, time: float) -> None:
        """Add the time (s) of a frame; times of a camera increase."""
        last = self._last.get(camera)
        self._last[camera] = time
        if last is None or time - last > LONGEST_STEP_S:
            return
        steps = self._steps.setdefault(camera, deque(maxlen=KEPT_STEPS))
        steps.append(time - last)
        self._periods[camera] = sorted(steps)[len(steps) // 2]

    @property
    def pairing_time(self) -> float:
        """Return the time (s) between two views that may start a person."""
        return pairing_time_of(self._periods.values())

    @property
    def typical(self) -> float:
        """Return the typical period (s) of a camera."""
        periods = sorted(self._periods.values())
        return periods[len(periods) // 2] if periods else USUAL_PERIOD_S


@dataclass(eq=False)
class OnlinePerson:
    """Person who is followed online.

    Args:
        id: number of the person, from confirmation on.
        track: filters, and the 2D people of the kept views.
        seen: the same views as arrays.
        learnt_at: (s) time of the newest learning.
        noise: learnt noise and stiffness, None before the first learning.
        distances: newest measurements of the lengths.
        bones: learnt lengths, None before there are enough measurements.
    """

    id: int
    track: ViewTrack
    seen: SeenViews
    learnt_at: float = -np.inf
    noise: LearntNoise | None = None
    distances: PairDistances | None = None
    bones: LearntLengths | None = None


@dataclass(eq=False)
class OnlineMotion:
    """Follows people through views in order of time, and gives their motion at recent instants.

    Args:
        arrays: cameras.
        mirror: (J,) joint on the other side of each joint.
        pairs: (P, 2) see `rigid_pairs`.
        people: (P) people who are followed, in the order of their confirmation.
        frames: the kept views and their times (s), by number.
        number: (int) number of the next view.
        ids: (int) number of the next person.
        periods: periods of the cameras.
    """

    arrays: RigArrays
    mirror: Array
    pairs: Array
    people: list[OnlinePerson] = field(default_factory=list)
    frames: dict[int, CameraFrame] = field(default_factory=dict)
    times: dict[int, float] = field(default_factory=dict)
    number: int = 0
    ids: int = 0
    periods: CameraPeriods = field(default_factory=CameraPeriods)

    def __post_init__(self) -> None:
        self.tracker = ViewTracker(self.arrays, self.mirror)
        sizes = [camera.image_size for camera in self.arrays.cameras]
        self._cameras = CameraRows(
            self.arrays.rotations,
            self.arrays.translations,
            np.array([1e-6 * camera.line_delay_us for camera in self.arrays.cameras]),
            np.array([0.5 * height for _, height in sizes]),
        )

    def middle_delay(self, camera: int) -> float:
        """Return the time (s) from the timestamp of a camera's view to the exposure of its middle row."""
        return float(self._cameras.lines[camera] * self._cameras.middles[camera])

    def take(self, frame: CameraFrame, time: float) -> None:
        """Take one view; times (s), those of the middle rows, must not decrease."""
        self.periods.take(frame.camera, time)
        self.tracker.pair_s = self.periods.pairing_time
        self.frames[self.number], self.times[self.number] = frame, time
        self.tracker.step(self.number, frame, time)
        self.number += 1
        oldest = next(iter(self.frames))
        while self.times[oldest] < time - LEARNING_S:
            del self.frames[oldest], self.times[oldest]
            oldest += 1
        self.tracker.ended.clear()
        known = {person.track.number: person for person in self.people}
        self.people = []
        for track in self.tracker.active:
            track.entries = [entry for entry in track.entries if entry.frame >= oldest]
            if track.confirmed:
                person = known.get(track.number) or self._new_person(track)
                self._update(person, oldest)
                self.people.append(person)

    def settle(self) -> None:
        """Learn from the newest views of one person, if that is due."""
        due = [p for p in self.people if p.track.last - p.learnt_at >= LEARN_EVERY_S]
        if due:
            self._learn(min(due, key=lambda person: person.learnt_at))

    def at(self, time: float) -> list[PersonInstant]:
        """Return the people at a time (s) from the views that were taken, without any effect on later results.

        People whose noise is not known yet are left out.
        """
        period = self.periods.typical
        found = []
        for person in self.people:
            if person.noise is not None and was_seen(np.array([time]), person.seen.times)[0]:
                fit = self._fit(person, person.noise, time)
                rays = fit.rays.weighted
                evidence = RayEvidence.of(
                    rays.starts, rays.times, fit.rays.cameras, fit.rays.scores / rays.growths
                )
                report = joint_report(
                    np.array([time]), fit.positions[None], fit.covariances[None], evidence, period
                ).at(0)
                if (report.states != JointState.MISSING).any():
                    found.append(PersonInstant(person.id, report, fit.velocities))
        return found

    def _new_person(self, track: ViewTrack) -> OnlinePerson:
        self.ids += 1
        return OnlinePerson(self.ids - 1, track, self._seen(track, 0))

    def _seen(self, track: ViewTrack, first: int) -> SeenViews:
        """Return the views of a track from frame number `first` on."""
        entries = [entry for entry in track.entries if entry.frame >= first]
        return SeenViews.of(entries, self.frames, self.times, self.mirror)

    def _update(self, person: OnlinePerson, oldest: int) -> None:
        """Add the newest view of a person, and remove views before frame number `oldest`."""
        seen = selected(person.seen, slice(int(np.searchsorted(person.seen.frames, oldest)), None))
        entries = person.track.entries
        turned = len(seen.frames) > 0 and entries[0].mirrored != seen.mirrored[0]
        if turned:  # left and right of the whole track
            person.seen = self._seen(person.track, 0)
        elif entries[-1].frame > seen.frames[-1] if len(seen.frames) else entries:
            person.seen = joined(seen, self._seen(person.track, entries[-1].frame))
        else:
            person.seen = seen

    def _learn(self, person: OnlinePerson) -> None:
        """Learn noise, stiffness and lengths from the newest views of a person."""
        rays = TrackRays.of_views(selected(person.seen, slice(-LEARNING_VIEWS, None)), self.arrays)
        cameras = self._cameras
        times = rays.stamps + cameras.lines[rays.cameras] * (rays.heights - cameras.middles[rays.cameras])
        origin, last = float(times.min()), float(times.max())
        grid = KnotGrid(origin, STEP_S, control_points(origin, last + STEP_S, STEP_S))
        problem = CurveProblem(rays, times, self.arrays, grid, person.noise)
        if person.noise is None:
            fit = problem.solve(FIRST_ROUNDS)
        else:
            early = person.seen.times[0] > person.track.last - 0.9 * LEARNING_S
            for _ in range(EARLY_ROUNDS if early else ROUNDS):
                fit = problem.fit()
                problem.learn(fit, problem.compare(fit))
        person.noise = problem.learnt
        new = pair_distances(problem, fit, self.pairs, max(person.learnt_at, origin))
        if person.distances is not None:
            new = PairDistances(*(np.concatenate(both, axis=1) for both in zip(person.distances, new)))
        person.distances = PairDistances(*(part[:, -KEPT_DISTANCES:] for part in new))
        person.learnt_at = person.track.last
        if person.distances.lengths.shape[1] >= LEAST_DISTANCES:
            person.bones = learn_lengths(person.distances)

    def _fit(self, person: OnlinePerson, noise: LearntNoise, time: float) -> InstantFit:
        """Return the joints of a person at a time (s)."""
        times = person.seen.times
        end = min(float(times[-1]), time + 0.5 * WINDOW_S)
        first, last = np.searchsorted(times, [end - WINDOW_S, end + 1e-9])
        seen = selected(person.seen, slice(int(first), int(last)))
        views, joints = seen.scores.shape
        cameras = np.repeat(seen.cameras, joints)
        model = JointNoiseModel(
            cameras, np.tile(np.arange(joints), views), seen.scores.ravel(), FIRST_NOISE, noise.factors
        )
        noises = model.sigmas().reshape(views, joints)
        rays = window_rays(seen, noises, self._cameras, CAUCHY, noise.persistent, MEMORY_S)
        stamps = rays.weighted.times
        origin, newest = float(stamps.min()), max(float(stamps.max()), time)
        grid = KnotGrid(origin, STEP_S, control_points(origin, newest + STEP_S, STEP_S))
        stiffness = np.repeat(noise.stiffness[:, None], grid.number - ORDER, axis=1)
        lengths = (NO_PAIRS, NO_LENGTHS) if person.bones is None else (self.pairs, person.bones)
        fit: InstantFit = fit_instant(
            rays, grid, stiffness, self._cameras, LEAST_DEPTH, CAUCHY, time, *lengths
        )
        return fit
