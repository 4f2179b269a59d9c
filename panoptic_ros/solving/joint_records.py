"""Input and output records of the joint solver, in the form that kernels take."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import AssociationSet, DetectionSet, Evidence, Groups, ViewSources
from panoptic_ros.kernels import njit

Array = np.ndarray

CHOICE_SPREAD = 0.03  # m, standard deviation of the prediction of a joint that was just measured
CHOICE_SPEED = 0.6  # m/s, growth of that standard deviation with the time since the measurement


class JointAssignment(NamedTuple):
    """Assignment of 2D joints to the joints of P people in V views.

    Args:
        member: (P, V) row of the person's 2D pose in each view, -1 = none.
        source: (P, V, J) joint of that 2D pose that stands for joint j.
        owner: (D, J) person that has claimed a 2D joint, -1 = free. Other people must not use it.
    """

    member: Array
    source: Array
    owner: Array


class JointPredictions(NamedTuple):
    """Predictions of the J joints of P people. They influence choices, but never positions.

    Args:
        positions: (P, J, 3) m, world, NaN = none.
        spreads: (P, J) m, standard deviations of `positions`.
        shifts: (P, J, 3) m/s, velocities.
        firm: (P, J) whether the prediction is certain enough to reject a joint that only two views support.
    """

    positions: Array
    spreads: Array
    shifts: Array
    firm: Array

    @classmethod
    def of_nobody_known(cls, people: int, joints: int, spread: float) -> JointPredictions:
        """Return guides of people without predictions.

        Args:
            spread: m, standard deviation that is entered for every joint.
        """
        shape = (people, joints, 3)
        return cls(
            np.full(shape, np.nan), np.full(shape[:2], spread), np.zeros(shape), np.zeros(shape[:2], bool)
        )


class PersonCandidates(NamedTuple):
    """P people for the final solve.

    Args:
        member: (P, V) row of the person's 2D pose in each view, -1 = none.
        source: (P, V, J) joint of that 2D pose that stands for joint j.
        guide: Predictions of the people.
        who: (P,) row of the person in the `Prediction`, -1 = new.
        places: (P, J, 3) m, world, first estimate of the joints, NaN = unknown.
    """

    member: Array
    source: Array
    guide: JointPredictions
    who: Array
    places: Array

    @classmethod
    def of(cls, item: AssociationSet, mirror: Array) -> PersonCandidates:
        """Return the people of an association. People with a prediction are guided, new people are not.

        Args:
            mirror: (J,) joint on the other side.
        """
        return cls.new(item.groups, item.places, mirror)._replace(guide=guides_of(item), who=item.who)

    @classmethod
    def new(cls, groups: Groups, places: Array, mirror: Array) -> PersonCandidates:
        """Return new people, who have no prediction.

        Args:
            groups: Their 2D poses.
            places: (P, J, 3) m, world, first estimates of their joints.
            mirror: (J,) joint on the other side.
        """
        member, mirrored = groups.member.copy(), groups.mirrored  # kernels need a writable array
        source = np.where(mirrored[..., None], mirror, np.arange(len(mirror))).astype(np.int64)
        guide = JointPredictions.of_nobody_known(len(places), places.shape[1], CHOICE_SPREAD)
        return cls(member, source, guide, np.full(len(member), -1), places)


class SolvedJoints(NamedTuple):
    """Solved joints of P people in V views.

    Args:
        positions: (P, J, 3) m, world. NaN where fewer than two views agree, or where only two views agree and
            contradict a firm prediction.
        normals: (P, J, 3, 3) 1/m^2, normal matrices, lower triangles.
        residuals: (P, J, V) in standard deviations, -1 = view unused.
        picks: (P, J, V, 2) row of the chosen 2D pose and index of its joint, -1 = none.
    """

    positions: Array
    normals: Array
    residuals: Array
    picks: Array

    @classmethod
    def nothing(cls, people: int, joints: int, views: int) -> SolvedJoints:
        """Return the record before any joint is solved."""
        shape = (people, joints, views)
        return cls(
            np.full((people, joints, 3), np.nan),
            np.zeros((people, joints, 3, 3)),
            np.full(shape, -1.0),
            np.full((*shape, 2), -1, np.int64),
        )

    @property
    def views(self) -> Array:
        """Return the number of views (P, J) behind each joint."""
        counts: Array = (self.residuals >= 0.0).sum(axis=-1)
        return counts


def guides_of(item: AssociationSet) -> JointPredictions:
    """Return the predictions of the people of an association; new people have none."""
    known = item.who >= 0
    guide = JointPredictions.of_nobody_known(len(known), item.places.shape[1], CHOICE_SPREAD)
    rows, prediction = item.who[known], item.prediction
    guide.positions[known], guide.shifts[known] = prediction.positions[rows], prediction.velocities[rows]
    guide.spreads[known] += CHOICE_SPEED * prediction.ages[rows]
    guide.firm[known] = prediction.firm[rows]
    return guide


def observed_views(found: PersonCandidates, precision: Array) -> Array:
    """Return whether each person's 2D pose in each view shows each joint (P, V, J).

    Args:
        precision: (D, J) of the 2D joints, 0 = missing.
    """
    member = found.member[..., None]
    if not len(precision):
        return np.zeros(found.source.shape, bool)
    usable: Array = (member >= 0) & (precision[np.maximum(member, 0), found.source] > 0.0)
    return usable


def view_sources(
    detections: DetectionSet, evidence: Evidence, found: PersonCandidates, solved: SolvedJoints, kept: Array
) -> ViewSources:
    """Return the record of the views and 2D poses behind the people that were kept.

    Args:
        kept: (K,) rows of these people in `found` and `solved`.
    """
    views = [detections.views[slot] for slot in evidence.slots]
    rows = main_people(evidence.starts, found.member[kept], solved.residuals[kept], solved.picks[kept])
    known = np.concatenate([evidence.rows, [-1]])  # so that row -1 gives -1
    frames = np.array([view.frame_number for view in views], np.int64)
    return ViewSources(tuple(view.camera for view in views), frames, known[rows])


@njit(cache=True, error_model="numpy")
def main_people(starts, member, residuals, picks):
    """Return the row (P, V) of the 2D pose that gave most joints to each person in each view, -1 = none.

    Detectors confuse people who overlap, so the joints of a person can come from two 2D poses of one view. A
    view in which association found no 2D pose has none, even if single joints of other poses were used.

    Args:
        starts: (V + 1,) first row of each view.
        member: (P, V) row that association gave, -1 = none. It wins if another row gave the same number of
            joints. It also wins if no joint of the view was used.
        residuals: (P, J, V), -1 = unused, see `SolvedJoints`.
        picks: (P, J, V, 2) row and joint index, see `SolvedJoints`.
    """
    people, joints, views = residuals.shape
    given = np.zeros(starts[-1])  # number of joints that each 2D pose gave to the person
    main = np.full((people, views), -1, np.int64)
    for p in range(people):
        for d in range(len(given)):
            given[d] = 0.0
        for j in range(joints):
            for v in range(views):
                if residuals[p, j, v] >= 0.0:
                    given[picks[p, j, v, 0]] += 1.0
        for v in range(views):
            best = member[p, v]
            for d in range(starts[v], starts[v + 1] if best >= 0 else starts[v]):
                if given[d] > given[best]:
                    best = d
            main[p, v] = best
    return main
