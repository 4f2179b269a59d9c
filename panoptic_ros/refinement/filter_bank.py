"""Kalman filters of all joints of all people, their smoother, and learnt gains on the motion of limbs.

Limbs seem to move too little in optical flow. The window of an image around a point of a limb also contains
the background, and flow follows a mixture of both (the generalised aperture problem, Black and Anandan 1996).
So limbs seem to move a tenth too little against the torso, for as long as they move. No covariance of single
displacements describes such an error.

Views measure the same motion, with errors that are independent of flow. The gain on displacements is the
slope of a regression of recent motion from views on recent motion from the surface. The gain belongs to
images and detector, so it is learnt from all people together. Each pair of joints (both elbows, both knees)
has its own gain.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import PartMotions, SkeletonModel, TimeShift, TrackedPoseSet
from panoptic_ros.domain.of_all import joined, of_all, selected
from panoptic_ros.domain.parts import rigid_parts
from panoptic_ros.geometry.robust import growth
from panoptic_ros.geometry.rotations import rotation_of
from panoptic_ros.refinement import fading
from panoptic_ros.refinement.bones import on_bones
from panoptic_ros.refinement.config import RefinementConfig
from panoptic_ros.refinement.joint_states import FILLED, MEASURED, SmoothedJoints, judge, take_measurements
from panoptic_ros.refinement.kalman import (
    predict,
    smooth,
    smoother_gains,
    update,
    update_velocities,
)
from panoptic_ros.refinement.links import JointDisplacements, links_of, predict_linked, with_views
from panoptic_ros.refinement.motion_model import MOVING, NINE, SIX, density, lasting_variance, transition
from panoptic_ros.refinement.records import (
    FilterState,
    MotionStates,
    PeopleStatistics,
    new_people,
    padded,
    started,
    unknown,
    widened,
)
from panoptic_ros.refinement.trust import given_up
from panoptic_ros.refinement.tuning import learn, learn_turns, nothing_lasting, process_noise, scales

SPAN = 0.3  # s, time constant of the recent motions by surface and by views, which are compared
MEMORY = 10.0  # s, time constant of the regression sums
PRIOR = 0.05**2 * SPAN  # m^2 s, weight of the prior gain of 1
SOFT = 0.05  # m, scale of the Cauchy weight on the difference of these motions
MOST = 1.5  # largest gain
Array = np.ndarray

STEADY = 1.0  # s, time constant of the covariances of persistent errors
SPEED_MEMORY = 0.3  # s, decay time of a joint's largest recent speed


class TorsoAndLimbs(NamedTuple):
    """Torso and limbs of a skeleton.

    Args:
        torso: Index of the torso in `rigid_parts`, -1 = none.
        kinds: Outer joints of the limbs; left and right counterparts form one group.
    """

    torso: int
    kinds: tuple[tuple[int, ...], ...]


def limbs_of(skeleton: SkeletonModel) -> TorsoAndLimbs:
    """Return the torso and the limbs of a skeleton."""
    parts = rigid_parts(skeleton)
    torso = next((number for number, part in enumerate(parts) if part.name == "torso"), -1)
    first_of = {right: left for left, right in skeleton.left_right}
    kinds: dict[int, list[int]] = {}
    for part in parts:
        if part.is_limb:
            outer = part.joints[1]
            kinds.setdefault(first_of.get(outer, outer), []).append(outer)
    return TorsoAndLimbs(torso, tuple(tuple(joints) for joints in kinds.values()))


def nothing_compared(limbs: TorsoAndLimbs) -> Array:
    """Return regression sums (K, 2) m^2 s of 0 for K kinds: surface times views, and surface squared."""
    return np.zeros((len(limbs.kinds), 2))


def with_torso(motions: PartMotions, torso: int, ids: Sequence[int], places: Array) -> Array:
    """Return the displacements (P, J, 3) m of joints that move rigidly with their torso, NaN = unknown.

    Args:
        motions: Motions of parts, including the torsos.
        torso: Index of the torso among the parts.
        ids: (P,) ids of the people.
        places: (P, J, 3) m, positions before the motion.
    """
    moved = np.full(places.shape, np.nan)
    row_of, rotation = {number: row for row, number in enumerate(ids)}, np.empty((3, 3))
    for k in np.flatnonzero(motions.parts == torso).tolist():
        row = row_of.get(int(motions.people[k]))
        if row is not None:
            rotation_of(motions.rotations[k], rotation)
            arms = places[row] - motions.centres[k]
            moved[row] = arms @ rotation.T - arms + motions.translations[k]
    return moved


def learn_shortfall(sums: Array, people: PeopleStatistics, kinds: Sequence[Sequence[int]], dt: float) -> None:
    """Add the recent motion of all people to the regression sums `sums` (K, 2) m^2 s.

    Args:
        people: Recent motions from surface and views.
        kinds: Joints of each kind.
        dt: s, duration of the newest motion.
    """
    sums *= np.exp(-dt / MEMORY)
    for k, joints in enumerate(kinds):
        surface, views = people.followed[:, joints], people.seen[:, joints]
        weights = dt / growth(np.square(views - surface).sum(axis=-1), SOFT)
        sums[k, 0] += (weights * (surface * views).sum(axis=-1)).sum()
        sums[k, 1] += (weights * np.square(surface).sum(axis=-1)).sum()


def add_motions(people: PeopleStatistics, surface: Array, views: Array, dt: float) -> None:
    """Add displacements against the torso to the sums of recent motion in `people`.

    Older displacements decay with the time constant `SPAN`. Joints with NaN start again at 0.

    Args:
        people: Learnt values; `followed` and `seen` are updated.
        surface: (P, J, 3) m, displacements from the surface.
        views: (P, J, 3) m, displacements from views.
        dt: s, duration of the displacements.
    """
    left = np.exp(-dt / SPAN)
    for kept, new in ((people.followed, surface), (people.seen, views)):
        kept[:] = left * (kept + new)
    known = np.isfinite(people.followed[..., 0] + people.seen[..., 0])
    people.followed[~known] = people.seen[~known] = 0.0


def gains_of(sums: Array) -> Array:
    """Return the gains (K,) on the motion of limbs relative to the torso, from 1 to `MOST`."""
    gains: Array = np.clip((sums[:, 0] + PRIOR) / (sums[:, 1] + PRIOR), 1.0, MOST)
    return gains


def in_full(
    links: JointDisplacements, carried: Array, kinds: Sequence[Sequence[int]], gains: Array
) -> JointDisplacements:
    """Return the links with gains on the motion of limbs relative to the torso.

    Args:
        carried: (P, J, 3) m, displacements that joints would have with the torso.
        kinds: Joints of each kind.
        gains: (K,) gain of each kind.
    """
    displacements = links.displacements.copy()
    for joints, gain in zip(kinds, gains.tolist()):
        more = (gain - 1.0) * (displacements[:, joints] - carried[:, joints])
        displacements[:, joints] += np.nan_to_num(more)
    return links._replace(displacements=displacements)


class FilterBank:
    """Filters of all people, and all moments that future results depend on."""

    def __init__(self, config: RefinementConfig, skeleton: SkeletonModel, lasting_share: float):
        """Create a bank without people.

        Args:
            lasting_share: Share of the variance of measurements that is due to persistent errors.
        """
        self._config, self._share = config, lasting_share
        self._parts = [list(part.joints) for part in rigid_parts(skeleton)]
        self._limbs = limbs_of(skeleton)
        self._joints, self._bones = len(skeleton), np.array(skeleton.bones, np.int64).reshape(-1, 2)
        self.memory = 0.0  # s, correlation time of accelerations; 0 = white
        self.moments: list[FilterState] = []
        self.people = new_people([], len(skeleton), len(self._bones))
        self.departed: dict[int, tuple[Array, Array]] = {}  # bone lengths and frames of people who left
        self.lasting = nothing_lasting()
        self.shortfall = nothing_compared(self._limbs)

    def take(self, item: TrackedPoseSet, motions: PartMotions | None = None) -> None:
        """Filter all people up to this set.

        Args:
            motions: Motions of parts since the previous set, measured on the surface; None = not measured.
        """
        if motions is not None and self.memory != self._config.acceleration_memory:
            self._widen()
        self._predict(item, motions)
        known = self.people.ids.tolist()
        new = [number for number in item.ids.tolist() if number not in known]
        if new:
            self._add(new)
        if len(item.ids):
            self._update(item)

    @property
    def _sized(self) -> tuple[int, ...]:
        """Return a tuple as long as the state of a joint; kernels are compiled for each length."""
        return NINE if self.memory > 0.0 else SIX

    def _widen(self) -> None:
        """Extend all states by accelerations.

        The first displacements of the surface trigger this, because they resolve correlated accelerations.
        """
        self.memory = self._config.acceleration_memory
        self.moments = [widened(moment, len(self._sized)) for moment in self.moments]
        for moment in self.moments[-1:]:
            self._at_random(moment.motion, moment.noise)

    def _at_random(self, motion: MotionStates, noise: Array) -> None:
        """Set variances of unknown accelerations in `motion` to stationary ones under the noise m^2/s^3."""
        last = range(MOVING, len(self._sized))
        motion.covariances[..., last, last] = lasting_variance(noise, self.memory)[..., None]

    def _predict(self, item: TrackedPoseSet, motions: PartMotions | None) -> None:
        """Predict all joints at the instant of a set, as a new moment."""
        config, people, stamp_ns = self._config, self.people, item.stamp_ns
        last = self.moments[-1] if self.moments else unknown(stamp_ns, 0.0, 0, self._joints, len(self._sized))
        dt = 1e-9 * (stamp_ns - last.stamp_ns)
        now = unknown(stamp_ns, dt, len(people.ids), self._joints, len(self._sized))
        people.speeds[...] *= np.exp(-dt / SPEED_MEMORY)
        states, least, growth = last.motion.states, config.process_noise, config.limb_noise
        process_noise(people.speeds, people.factors, states, least, growth, now.noise)
        step = transition(dt, self.memory)
        predict(self._sized, last.motion, step, now.noise, now.predicted)
        if config.lag > 0.0:  # without a lag nothing is smoothed
            smoother_gains(self._sized, last.motion, step, now.predicted, now.gains)
        links = links_of(motions, self._parts, people.ids, states) if motions is not None else None
        if links is not None and motions is not None:
            links = self._corrected(links, motions, last, item)
            now.linked[...] = linked = np.isfinite(links.displacements[..., 0])
            now.noise[linked] *= density(self.memory)
            turns = np.full_like(people.turns, np.nan)
            predict_linked(
                self._sized,
                last.motion,
                step,
                now.noise,
                links,
                config.cauchy,
                now.predicted,
                now.gains,
                turns,
            )
            learn_turns(people, turns, dt)
            np.logical_and(last.measured.carried, linked, out=now.measured.carried)
        else:
            people.turns[...] = np.nan
        for name in ("scores", "noises", "person_scores", "filled", "trust", "lasting"):
            getattr(now.measured, name)[...] = getattr(last.measured, name)
        np.add(last.measured.ages, dt, out=now.measured.ages)
        now.predicted.states[(now.measured.ages > config.max_gap) & ~now.measured.carried] = np.nan
        now.motion.states[...], now.motion.covariances[...] = now.predicted
        self.moments.append(now)

    def _corrected(
        self, links: JointDisplacements, motions: PartMotions, last: FilterState, item: TrackedPoseSet
    ) -> JointDisplacements:
        """Return links with gains on limbs, combined with the displacements that views measured.

        Displacements of filled joints are excluded, because these joints depend on earlier estimates. Views
        contribute only if all of them have the same timestamp.
        """
        row_of = {number: row for row, number in enumerate(self.people.ids.tolist())}
        known = [k for k, number in enumerate(item.ids.tolist()) if number in row_of]
        rows = np.array([row_of[number] for number in item.ids[known].tolist()], np.int64)
        moved = item.positions[known] - last.measured.points[rows]
        moved[(item.states[known] == FILLED) | last.measured.filled[rows]] = np.nan
        seen, together = np.full_like(links.displacements, np.nan), item.time_shift is None
        if together:
            seen[rows] = moved
        (torso, kinds), dt = self._limbs, 1e-9 * (item.stamp_ns - last.stamp_ns)
        carried = with_torso(motions, torso, list(row_of), last.motion.states[..., :3])
        add_motions(self.people, links.displacements - carried, seen - carried, dt)
        learn_shortfall(self.shortfall, self.people, kinds, dt)
        links = in_full(links, carried, kinds, gains_of(self.shortfall))
        if not together or self._config.difference_share <= 0.0:
            return links
        share = self._config.difference_share
        return with_views(links, rows, moved, share * (item.covariances[known] + last.measured.noises[rows]))

    def _add(self, ids: list[int]) -> None:
        """Add people with unknown states; people who were present before keep their bone lengths."""
        people = new_people(ids, self._joints, len(self._bones))
        nobody = unknown(0, 0.0, len(ids), self._joints, len(self._sized))
        nobody.noise[...] = self._config.process_noise
        for row, number in enumerate(ids):
            if number in self.departed:
                people.lengths[row], people.frames[row] = self.departed.pop(number)
        self.people = joined(self.people, people)
        self.moments = [joined(moment, nobody) for moment in self.moments]

    def _update(self, item: TrackedPoseSet) -> None:
        """Update the newest moment with the measurements of its instant."""
        now, config, shift, points = self.moments[-1], self._config, item.time_shift, item.positions
        row_of = {number: row for row, number in enumerate(self.people.ids.tolist())}
        rows = np.array([row_of[number] for number in item.ids.tolist()])
        now.measured.person_scores[rows] = item.person_scores
        take_measurements(now.measured, rows, points, item.covariances, item.scores, item.views)
        there = np.isfinite(points[..., 0])
        now.measured.filled[rows] = np.where(there, item.states == FILLED, now.measured.filled[rows])
        now.measured.points[rows] = points
        if self._share > 0.0:
            self._keep_lasting(now)
        innovations, noises = np.full((*now.noise.shape, 3), np.nan), now.measured.noises
        # own arrays, because kernels are loaded once more for read-only ones
        points, delays = points.copy(), np.zeros((0, *points.shape[1:], 3))
        if shift is not None:
            points += (shift.delays @ shift.assumed[..., None])[..., 0]
            delays = shift.delays.copy()
        update(self._sized, now.motion, rows, (points, noises, delays), config.cauchy, innovations)
        if shift is not None:
            velocities, information = shift.velocities, shift.information
            update_velocities(self._sized, now.motion, rows, velocities, information, config.cauchy)
        innovations[now.measured.filled] = np.nan  # filled joints depend on earlier estimates
        learn(self.people, now.measured.people, innovations, self.lasting)
        if now.linked.any():
            wrong = given_up(now.measured.trust, innovations, now.linked, now.dt, config.cauchy)
            now.motion.states[wrong] = now.predicted.states[wrong] = np.nan
        new = now.measured.joints & np.isnan(now.motion.states[:, :, 0])
        for k in np.flatnonzero(new[rows].any(axis=1)).tolist() if new.any() else ():
            self._start(rows[k], new[rows[k]], points[k], None if shift is None else shift.rows([k]))

    def _keep_lasting(self, now: FilterState) -> None:
        """Update the covariances of persistent errors in a moment, as running means over `STEADY`.

        These covariances change slowly, so that bones that depend on them do not shake. A measured joint adds
        a share of its measurement noise. A joint that is not measured adds its whole last noise: the cause of
        its errors is also the cause of its loss.
        """
        measured = now.measured
        shares = np.where(measured.joints, self._share, float(self._share > 0.0))[..., None, None]
        new = np.trace(measured.lasting, axis1=-2, axis2=-1) == 0.0
        gains = np.where(new, 1.0, -np.expm1(-now.dt / STEADY))
        gains[measured.filled] = 0.0
        measured.lasting[...] += gains[..., None, None] * (shares * measured.noises - measured.lasting)

    def _start(self, row: int, new: Array, points: Array, shift: TimeShift | None) -> None:
        """Initialise the states of a person's new joints (J,) at rest, from points (J, 3) m.

        Args:
            row: Row of the person.
            new: (J,) whether the joint is new.
            shift: Time shift of this person alone; None = all views have the same timestamp.
        """
        now = self.moments[-1]
        delays = np.zeros((self._joints, 3, 3)) if shift is None else shift.delays[0]
        begun = started(points, now.measured.noises[row], delays, self._config.start_speed)
        begun = padded(begun, len(self._sized))
        self._at_random(begun, now.noise[row])
        for whole, part in zip(now.motion, begun):
            whole[row, new] = part[new]

    def smoothed(self, index: int, ahead: float) -> SmoothedJoints:
        """Return the joints of all people at a kept moment, smoothed with all later measurements.

        Args:
            index: Index of the moment.
            ahead: s from the moment to the wanted instant, which lies before the next moment.
        """
        kept = self.moments[index:]
        target, motion = kept[0], of_all(np.copy, kept[-1].motion)
        again = np.zeros_like(target.measured.joints)  # measured again later, without an interruption
        for now, after in zip(kept[-2::-1], kept[:0:-1]):
            before, gains, predicted = now.motion, after.gains, after.predicted
            if now is target and ahead > 0.0:
                before, gains = self._ahead(before, ahead, after.noise), np.empty_like(gains)
                # the displacement spans the whole interval, and the velocity already contains it
                if after.linked.any():
                    predicted = self._ahead(before, after.dt - ahead, after.noise)
                rest = transition(after.dt - ahead, self.memory)
                smoother_gains(self._sized, before, rest, predicted, gains)
            smooth(self._sized, before, gains, predicted, after.measured.joints, motion, again)
        if len(kept) == 1 and ahead > 0.0:
            motion = self._ahead(motion, ahead, target.noise)
        self._fade(index, motion, 0.0 < ahead)
        return self._judged(target, motion, again)

    def _fade(self, index: int, motion: MotionStates, between: bool) -> None:
        """Apply corrections of the previous moment gradually to the positions in `motion`.

        Later measurements correct the joints at both moments together. The output would jump, although the
        joint did not. The motion since the previous moment is known from the surface and is applied at once.

        Args:
            index: Index of the moment.
            motion: Smoothed motion; positions change.
            between: Whether `motion` belongs to an instant after the moment. Then nothing changes, and no
                difference is kept.
        """
        target, people = self.moments[index], self.people
        if index > 0 and not between and target.linked.any():
            before = of_all(np.copy, motion)
            again = np.zeros_like(target.measured.joints)
            last = self.moments[index - 1].motion
            smooth(self._sized, last, target.gains, target.predicted, again, before, again)
            span = max(self._config.fading * self._config.lag, fading.LEAST)
            apart = people.found + people.left - before.states[..., :MOVING]
            left = fading.settled(apart, target.linked, target.dt, span)
            people.left[...], people.found[...] = left, motion.states[..., :MOVING]
            motion.states[..., :3] += left[..., :3]
        else:
            people.left[...], people.found[...] = 0.0, np.nan if between else motion.states[..., :MOVING]

    def _ahead(self, motion: MotionStates, dt: float, noise: Array) -> MotionStates:
        """Return the motion predicted by dt s under process noise (P, J) m^2/s^3."""
        moved = of_all(np.empty_like, motion)
        predict(self._sized, motion, transition(dt, self.memory), noise, moved)
        return moved

    def _judged(self, target: FilterState, motion: MotionStates, again: Array) -> SmoothedJoints:
        """Return joints and their states, corrected by bone lengths; covariances include persistent errors.

        Bone lengths do not reduce the covariances of persistent errors, because learnt lengths have the same
        errors.

        Args:
            motion: Smoothed motion at the wanted instant.
            again: (P, J) whether a joint is measured again later, without an interruption.
        """
        config, measured, shape = self._config, target.measured, again.shape
        lasting = np.where(measured.joints, self._share, float(self._share > 0.0))
        lasting[measured.filled] = 1.0  # filled by bone lengths and predictions, whose errors persist
        limits = config.max_sigma, config.max_prediction
        places, spreads, scores = np.empty((*shape, 3)), np.empty((*shape, 3, 3)), np.empty(shape)
        judged = SmoothedJoints(places, spreads, scores, np.empty(shape, np.uint8))
        judge(motion, measured, again, scales(self.people, self.lasting), lasting, limits, judged)
        if config.bone_sigma > 0.0:
            errs = measured.lasting if self._share > 0.0 else None
            on_bones(judged, self.people, self._bones, (config.bone_sigma, config.bone_frames), errs, target)
        if lasting.any():
            spreads += lasting[..., None, None] * measured.noises
        judged.states[measured.filled & (judged.states == MEASURED)] = FILLED
        return judged

    def forget(self, stamp_ns: int) -> None:
        """Drop people who have left, and moments that smoothing after this timestamp does not need."""
        gone = self.moments[-1].measured.ages.min(axis=1) > self._config.max_gap + self._config.lag
        for moment in self.moments if gone.any() else ():
            if moment.stamp_ns > stamp_ns:
                gone &= ~moment.measured.people
        if gone.any():
            left, self.people = selected(self.people, gone), selected(self.people, ~gone)
            self.departed.update(zip(left.ids.tolist(), zip(left.lengths, left.frames)))
            self.moments = [selected(moment, ~gone) for moment in self.moments]
        while len(self.moments) > 1 and self.moments[1].stamp_ns <= stamp_ns:
            self.moments.pop(0)
