"""Motion as a function of time while the views arrive: each instant from the views up to a lag later."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from panoptic_ros.continuous.bones import (
    LearntLengths,
    PairDistances,
    learn_lengths,
    pair_distances,
    rigid_pairs,
)
from panoptic_ros.continuous.bystanders import are_inside, has_human_size
from panoptic_ros.continuous.config import ContinuousStageConfig
from panoptic_ros.continuous.curves import ORDER, KnotGrid
from panoptic_ros.continuous.follow import ViewTrack, ViewTracker
from panoptic_ros.continuous.instant import CameraRows, InstantFit, fit_instant, window_rays
from panoptic_ros.continuous.motion import predict
from panoptic_ros.continuous.periods import CameraPeriods
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
from panoptic_ros.continuous.reports import (
    JointReport,
    RayEvidence,
    add_biases,
    add_calibration,
    joint_report,
    was_seen,
)
from panoptic_ros.continuous.returns import DISTANCE, TAIL_S, TOGETHER, ReturnSearch, SeenPerson
from panoptic_ros.continuous.seen_views import SeenViews
from panoptic_ros.domain import JointState, SkeletonModel
from panoptic_ros.domain.of_all import joined
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.geometry.splines import control_points
from panoptic_ros.identity.likeness import NEW, WAIT
from panoptic_ros.identity.numbering import numbering_order, numbering_places
from panoptic_ros.identity.returns import is_pause
from panoptic_ros.identity.subjects import PublicIds, subjects_of
from panoptic_ros.solving.calibration_errors import CalibrationErrors
from panoptic_ros.solving.capture_space import needed_views
from panoptic_ros.solving.frames import CameraFrame
from panoptic_ros.solving.joint_noise import JointNoiseModel

Array = np.ndarray
BEFORE_S, AFTER_S = 0.3, 0.25  # s before and after an instant of views from which it is computed
# s of views that are kept, and number of newest views from which noise, stiffness and lengths are learnt
LEARNING_S, LEARNING_VIEWS = 1.6, 120
LEARN_EVERY_S = 0.15  # s between two times of learning
# iterations of learning: of a new person, while a person has fewer views than LEARNING_S, and later
FIRST_ROUNDS, EARLY_ROUNDS, ROUNDS = 8, 3, 1
# s from the appearance of a person to its number: those who appear together are confirmed within it
HOLD_S = 0.1
# periods of a camera, lower limit of that time while others may appear: each person needs five views
HOLD_PERIODS = 2.0
# m per axis, standard deviation up to which a joint counts for the place of a person; others would move it
CERTAIN = 0.03
KEPT_DISTANCES = 500  # number of newest measurements of lengths that are kept
LEAST_DISTANCES = 25  # minimum number of measurements from which lengths are used
NO_PAIRS = np.zeros((0, 2), np.int64)
NO_LENGTHS = LearntLengths(np.zeros(0), np.zeros(0), np.zeros(0))


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


@dataclass(eq=False)
class OnlinePerson:
    """Person who is followed online.

    Args:
        id: Number of the person; -1 = not numbered yet, such people are not reported.
        track: Filters, and the 2D people of the kept views.
        seen: The same views as arrays.
        last_watched: Time of the newest view on the clock without pauses, s.
        learnt_at: Time of the newest learning, s.
        noise: Learnt noise and stiffness. None before the first learning.
        distances: Newest measurements of the lengths.
        bones: Learnt lengths. None before there are enough measurements.
        appeared: Time of appearance, s. Infinite = it was never in the capture space, and is not reported.
        undecided: Whether the person may be one who was lost long ago, see `identity.likeness.WAIT`.
    """

    id: int
    track: ViewTrack
    seen: SeenViews
    last_watched: float
    learnt_at: float = -np.inf
    noise: LearntNoise | None = None
    distances: PairDistances | None = None
    bones: LearntLengths | None = None
    appeared: float = np.inf
    undecided: bool = False


class OnlineMotion:
    """Follows people through views in order of time, and gives their motion at recent instants.

    Args:
        arrays: cameras.
    """

    def __init__(self, arrays: RigArrays, skeleton: SkeletonModel, config: ContinuousStageConfig):
        self._needed_views = needed_views(config.capture_views, arrays.cameras)
        self._memory, self._patience = config.memory, config.recognition_time
        self._bystanders = config.bystanders
        self._calibration = CalibrationErrors.of(arrays.cameras)
        self._bias_floors = skeleton.bias_floors
        self._arrays, self._mirror = arrays, np.array(skeleton.mirror)
        self._pairs, self._derived = rigid_pairs(skeleton), skeleton.derived
        self._search = ReturnSearch(skeleton, self._pairs)
        self._cameras = CameraRows(
            arrays.rotations,
            arrays.translations,
            np.array([1e-6 * camera.line_delay_us for camera in arrays.cameras]),
            np.array([0.5 * camera.image_size[1] for camera in arrays.cameras]),
        )
        self._tracker = ViewTracker(arrays, self._mirror)
        self._periods = CameraPeriods()
        self._frames: dict[int, CameraFrame] = {}  # kept views, by number
        self._times: dict[int, float] = {}  # s, of the kept views
        self._number = 0  # number of the next view
        self._newest: float | None = None  # s, time of the newest view
        self._clock = 0.0  # s, the same on a clock that stands still in pauses of all cameras
        self._people: dict[int, OnlinePerson] = {}  # by number of the track
        self._lost: dict[int, SeenPerson] = {}  # people who may return, by id
        self.ids = PublicIds(subjects_of(config.subjects))

    def succeed(self, earlier: OnlineMotion) -> None:
        """Take over the ids of an earlier motion, whose people may return."""
        self.ids, self._clock, self._newest = earlier.ids, earlier._clock, earlier._newest
        people = [person for person in earlier._people.values() if person.id >= 0]
        self._lost = earlier._lost | {person.id: earlier._lost_person(person) for person in people}

    def middle_delay(self, camera: int) -> float:
        """Return the time (s) from the timestamp of a camera's view to the exposure of its middle row."""
        return float(self._cameras.lines[camera] * self._cameras.middles[camera])

    def take(self, frame: CameraFrame, time: float) -> None:
        """Take one view; times (s), those of the middle rows, must not decrease."""
        step = 0.0 if self._newest is None else max(time - self._newest, 0.0)
        self._clock += 0.0 if is_pause(step) else step
        self._newest = time
        self._periods.take(frame.camera, time)
        self._tracker.pair_s = self._periods.pairing_time
        self._frames[self._number], self._times[self._number] = frame, time
        self._tracker.step(self._number, frame, time)
        self._number += 1
        oldest = next(iter(self._frames))
        while self._times[oldest] < time - LEARNING_S:
            del self._frames[oldest], self._times[oldest]
            oldest += 1
        self._lose()
        for track in list(self._tracker.active):
            track.keep(oldest)
            if track.confirmed:
                if track.number not in self._people:
                    self._people[track.number] = OnlinePerson(-1, track, self._seen(track, 0), self._clock)
                person = self._people[track.number]
                self._update(person, oldest)
                if track.last == time:
                    person.last_watched = self._clock
        self._number_people(time)

    def find_subjects(self, stamp_ns: int) -> list[tuple[int, int]]:
        """Give their ids to subjects among the people who are seen; return the new and earlier ids.

        Args:
            stamp_ns: time of the newest view.
        """
        if not len(self.ids.subjects.ids):
            return []
        people = [person for person in self._people.values() if person.id >= 0]
        ids = np.array([*(person.id for person in people), *self._lost], np.int64)
        here = np.zeros(len(ids), bool)
        here[: len(people)] = [person.track.last >= person.track.time - HOLD_S for person in people]

        def bodies(rows: Array) -> tuple[Array, Array]:
            states = np.array([people[row].track.filters.states[:, :2] for row in rows])
            middles = np.nanmedian(states, axis=1)
            return middles[:, 0], middles[:, 1]

        found = self.ids.find_subjects(ids, here, bodies, stamp_ns)
        if found:
            for person, number in zip(people, ids.tolist()):
                person.id = number
            self._lost = dict(zip(ids[len(people) :].tolist(), self._lost.values()))
        return found

    def settle(self) -> None:
        """Learn from the newest views of one person, if that is due."""
        due = [p for p in self._people.values() if p.track.last - p.learnt_at >= LEARN_EVERY_S]
        if due:
            self._learn(min(due, key=lambda person: person.learnt_at))

    def at(self, time: float) -> list[PersonInstant]:
        """Return the people at a time (s), by id, from the views that were taken. Nothing is changed.

        People whose noise or number is not known yet are left out, and so are bystanders.
        """
        period = self._periods.typical
        found = []
        people = list(self._people.values())
        reported = self.ids.are_reported(np.array([person.id for person in people]), self._bystanders)
        for person in (people[row] for row in np.flatnonzero(reported)):
            if person.noise is None or person.id < 0:
                continue
            if person.bones is not None and not has_human_size(person.bones.lengths):
                continue
            if was_seen(np.array([time]), person.seen.times)[0]:
                fit = self._fit(person, person.noise, time)
                rays = fit.rays.weighted
                evidence = RayEvidence.of(
                    rays.starts, rays.times, fit.rays.cameras, fit.rays.scores / rays.growths
                )
                when, kept = np.array([time]), (evidence, period, self._derived)
                whole = joint_report(when, fit.positions[None], fit.covariances[None], *kept)
                add_calibration(whole, when, *kept, self._calibration)
                add_biases(whole, self._bias_floors)
                report = whole.at(0)
                if (report.states != JointState.MISSING).any():
                    found.append(PersonInstant(person.id, report, fit.velocities))
        return sorted(found, key=lambda one: one.id)

    def _lose(self) -> None:
        """Move people whose tracks have ended to those who may return."""
        for track in self._tracker.ended:
            person = self._people.pop(track.number, None)
            if person is not None and person.id >= 0:
                self._lost[person.id] = self._lost_person(person)
        self._tracker.ended.clear()
        # people are numbered some time after their first view
        oldest = self._clock - self._memory - LEARNING_S
        self._lost = {k: lost for k, lost in self._lost.items() if self._is_remembered(k, lost, oldest)}

    def _is_remembered(self, number: int, lost: SeenPerson, oldest: float) -> bool:
        """Return whether a person was seen after a time (s, without pauses). Subjects are never forgotten."""
        return lost.watched >= oldest or number in self.ids.subjects.ids

    def _lost_person(self, person: OnlinePerson) -> SeenPerson:
        """Return a person as last seen."""
        filters = person.track.filters.copy()
        predict(filters, person.track.last - person.track.time)
        place = numbering_places(filters.states[None, :, 0])[0]
        lengths = self._search.bone_lengths(person.bones)
        return SeenPerson(person.track.last, person.last_watched, place, *lengths)

    def _number_people(self, time: float) -> None:
        """Number the people who have appeared, at a time (s): those who were lost, and then new ones.

        The track of a person who was not seen since another track of it began ends.
        """
        known = [p for p in self._people.values() if p.id >= 0]
        unseen = {p.id: p for p in known if p.track.last < time - HOLD_S}
        new = [p for p in self._people.values() if p.id < 0 and p.appeared <= time]
        new = [p for p in new if time >= p.appeared + TAIL_S or not self._may_be_of(p, known, time)]
        settled = all(track.confirmed for track in self._tracker.active)
        settled &= all(np.isfinite(person.appeared) for person in self._people.values())
        hold = HOLD_S if settled else max(HOLD_S, HOLD_PERIODS * self._periods.typical)
        if time < min((p.appeared for p in new if not p.undecided), default=-np.inf) + hold:
            new = [p for p in new if p.undecided]
        if not new:
            return
        begin = min(p.appeared for p in new)
        lost = dict(self._lost)
        for number, one in unseen.items():
            lost[number] = self._lost_person(one)._replace(place=self._place_at(one, begin))
        firsts = [self._first_seen(p, time) for p in new]
        possible = np.ones((len(lost), len(new)), bool)
        for row, (number, away) in enumerate(lost.items()):
            for k, p in enumerate(new):
                shared = number in unseen and _share_view(p, unseen[number])
                kept = self._is_remembered(number, away, firsts[k].watched - self._memory)
                possible[row, k] = kept and not shared
        seconds = np.array([time - p.appeared for p in new])
        found = self._search.returned(list(lost.values()), firsts, possible, seconds, self._patience)
        for k, row in enumerate(found.tolist()):
            new[k].undecided = row == WAIT
            if row in (NEW, WAIT):
                continue
            number = list(lost)[row]
            self._lost.pop(number, None)
            if number in unseen:
                earlier = unseen[number].track
                self._tracker.active.remove(earlier)
                del self._people[earlier.number]
            new[k].id = number
        rows = [k for k, p in enumerate(new) if p.id < 0 and not p.undecided]
        places = np.array([firsts[k].place for k in rows]).reshape(-1, 2)
        times = np.array([firsts[k].time for k in rows])
        for k in numbering_order(places, times, TOGETHER * self._periods.typical):
            new[rows[k]].id = self.ids.new()

    def _may_be_of(self, person: OnlinePerson, others: Sequence[OnlinePerson], time: float) -> bool:
        """Return whether a person may be one of others, seen at a time (s): near, and in no common view.

        The track of the other then ends soon. It drifts away, so places are those at the appearance.
        """
        came = person.appeared
        return any(
            other.track.last >= time - HOLD_S
            and not _share_view(person, other)
            and np.linalg.norm(self._place_at(other, came) - self._place_at(person, came)) <= DISTANCE
            for other in others
        )

    def _place_at(self, person: OnlinePerson, time: float) -> Array:
        """Return the place (2,) m of a person at a time (s), or at the nearest time with views of it."""
        assert person.noise is not None  # it is learnt before people appear
        first = float(person.seen.times[0])
        return _place(self._fit(person, person.noise, max(first, min(time, person.track.last))))

    def _first_seen(self, person: OnlinePerson, time: float) -> SeenPerson:
        """Return a person as it appeared, from the views up to a time (s)."""
        assert person.noise is not None
        came = max(person.appeared, float(person.seen.times[0]))  # older views are forgotten
        fit = self._fit(person, person.noise, came)
        if person.bones is None:
            lengths = self._search.instant_lengths(fit.positions, fit.covariances)
        else:
            lengths = self._search.bone_lengths(person.bones)
        return SeenPerson(came, self._clock - (time - came), _place(fit), *lengths)

    def _seen(self, track: ViewTrack, first: int) -> SeenViews:
        """Return the views of a track from frame number `first` on."""
        entries = [entry for entry in track.entries if entry.frame >= first]
        return SeenViews.of(entries, self._frames, self._times, self._mirror)

    def _update(self, person: OnlinePerson, oldest: int) -> None:
        """Add the newest view of a person, and remove views before frame number `oldest`."""
        seen = person.seen.part(int(np.searchsorted(person.seen.frames, oldest)))
        first, last = person.track.entries[0], person.track.entries[-1]
        if not len(seen.frames) or first.mirrored != seen.mirrored[0]:  # left and right were exchanged
            seen = self._seen(person.track, 0)
        elif last.frame > seen.frames[-1]:
            seen = joined(seen, self._seen(person.track, last.frame))
        person.seen = seen

    def _learn(self, person: OnlinePerson) -> None:
        """Learn noise, stiffness and lengths from the newest views of a person."""
        rays = TrackRays.of_views(person.seen.part(-LEARNING_VIEWS), self._arrays)
        cameras = self._cameras
        times = rays.stamps + cameras.lines[rays.cameras] * (rays.heights - cameras.middles[rays.cameras])
        origin, last = float(times.min()), float(times.max())
        grid = KnotGrid(origin, STEP_S, control_points(origin, last + STEP_S, STEP_S))
        problem = CurveProblem(rays, times, self._arrays, grid, person.noise)
        if person.noise is None:
            fit = problem.solve(FIRST_ROUNDS)
        else:
            early = person.seen.times[0] > person.track.last - 0.9 * LEARNING_S
            for _ in range(EARLY_ROUNDS if early else ROUNDS):
                fit = problem.fit()
                problem.learn(fit, problem.compare(fit))
        first = person.noise is None
        person.noise = problem.learnt
        since = max(person.learnt_at, origin)
        new = pair_distances(problem, fit, self._pairs, since)
        if person.distances is not None:
            new = PairDistances(*(np.concatenate(both, axis=1) for both in zip(person.distances, new)))
        person.distances = PairDistances(*(part[:, -KEPT_DISTANCES:] for part in new))
        person.learnt_at = person.track.last
        if person.appeared == np.inf and self._is_inside(person):
            person.appeared = float(person.seen.times[0]) if first else person.track.last
        if person.distances.lengths.shape[1] >= LEAST_DISTANCES:
            person.bones = learn_lengths(person.distances)

    def _is_inside(self, person: OnlinePerson) -> bool:
        """Return whether a person of human size is in the capture space now."""
        ends = person.track.positions[self._pairs]
        if not has_human_size(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)):
            return False
        inside = are_inside(
            np.array([person.track.time]),
            person.track.positions[None],
            person.seen.times,
            person.seen.cameras,
            self._periods.typical,
            self._arrays.cameras,
            self._needed_views,
        )
        return bool(inside[0])

    def _fit(self, person: OnlinePerson, noise: LearntNoise, time: float) -> InstantFit:
        """Return the joints of a person at a time (s)."""
        times = person.seen.times
        begin = min(time, float(times[-1])) - BEFORE_S
        first, last = np.searchsorted(times, [begin, time + AFTER_S])
        seen = person.seen.part(int(first), int(last))
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
        lengths = (NO_PAIRS, NO_LENGTHS) if person.bones is None else (self._pairs, person.bones)
        fit: InstantFit = fit_instant(
            rays, grid, stiffness, self._cameras, LEAST_DEPTH, CAUCHY, time, *lengths
        )
        return fit


def _share_view(person: OnlinePerson, other: OnlinePerson) -> bool:
    """Return whether a view shows both."""
    return bool(np.isin(person.seen.frames, other.seen.frames).any())


def _place(fit: InstantFit) -> Array:
    """Return the place (2,) m of a person by the joints that are known well, see `numbering_places`."""
    sigmas = np.sqrt(np.trace(fit.covariances, axis1=-2, axis2=-1) / 3.0)
    sure = sigmas <= max(CERTAIN, float(sigmas.min()))
    place: Array = numbering_places(fit.positions[None, sure])[0]
    return place
