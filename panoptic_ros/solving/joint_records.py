"""What the solver of joints is given and what it gives, as kernels take it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import AssociationSet, DetectionSet, Evidence, Groups, ViewSources
from panoptic_ros.kernels import njit

Array = np.ndarray

CHOICE_SPREAD = 0.03  # m, standard deviation of a prediction of a joint that was just measured
CHOICE_SPEED = 0.6  # m/s, its growth with the time since the measurement


class Claims(NamedTuple):
    """Which observations are whose: P people, V views.

    member: (P, V) the 2D person of each view, -1 = none. source: (P, V, J) its joint that stands for joint j.
    owner: (D, J) person that has claimed an observation, -1 = free; others may not use it.
    """

    member: Array
    source: Array
    owner: Array


class Guides(NamedTuple):
    """Predictions of P people's J joints, which are used in choices and never in positions.

    positions: (P, J, 3) m, NaN = none. spreads: (P, J) m, standard deviations. shifts: (P, J, 3) m/s,
    velocities. firm: (P, J) whether the position is certain enough to reject what two views say.
    """

    positions: Array
    spreads: Array
    shifts: Array
    firm: Array

    @classmethod
    def of_nobody_known(cls, people: int, joints: int, spread: float) -> Guides:
        """People without predictions."""
        shape = (people, joints, 3)
        return cls(
            np.full(shape, np.nan), np.full(shape[:2], spread), np.zeros(shape), np.zeros(shape[:2], bool)
        )


class Candidates(NamedTuple):
    """P people for the final solve.

    member: (P, V) the 2D person of each view, -1 = none. source: (P, V, J) which of its joints stands for
    joint j. guide: their predictions. who: (P,) index of the prediction, -1 = new. places: (P, J, 3) m,
    first estimate of their joints, NaN = unknown.
    """

    member: Array
    source: Array
    guide: Guides
    who: Array
    places: Array

    @classmethod
    def of(cls, item: AssociationSet, mirror: Array) -> Candidates:
        """The people of an association: those who were predicted are guided, new ones are not.

        Args:
            mirror: (J,) the joint on the other side.
        """
        return cls.new(item.groups, item.places, mirror)._replace(guide=guides_of(item), who=item.who)

    @classmethod
    def new(cls, groups: Groups, places: Array, mirror: Array) -> Candidates:
        """People whom nobody predicted, with first estimates (P, J, 3) m of their joints."""
        member, mirrored = groups.member.copy(), groups.mirrored  # kernels take what can be changed
        source = np.where(mirrored[..., None], mirror, np.arange(len(mirror))).astype(np.int64)
        guide = Guides.of_nobody_known(len(places), places.shape[1], CHOICE_SPREAD)
        return cls(member, source, guide, np.full(len(member), -1), places)


class SolvedJoints(NamedTuple):
    """Joints of P people in V views.

    positions (P, J, 3) m, NaN where fewer than two views agree. normals (P, J, 3, 3) 1/m^2, lower triangles.
    residuals (P, J, V) in standard deviations, -1 = unused. picks (P, J, V, 2) 2D person and joint of it,
    -1 = none.
    """

    positions: Array
    normals: Array
    residuals: Array
    picks: Array

    @classmethod
    def nothing(cls, people: int, joints: int, views: int) -> SolvedJoints:
        """Before anything is solved."""
        shape = (people, joints, views)
        return cls(
            np.full((people, joints, 3), np.nan),
            np.zeros((people, joints, 3, 3)),
            np.full(shape, -1.0),
            np.full((*shape, 2), -1, np.int64),
        )

    @property
    def views(self) -> Array:
        """Number of views (P, J) behind each joint."""
        counts: Array = (self.residuals >= 0.0).sum(axis=-1)
        return counts


def guides_of(item: AssociationSet) -> Guides:
    """The predictions of the people of an association; new ones have none."""
    known = item.who >= 0
    guide = Guides.of_nobody_known(len(known), item.places.shape[1], CHOICE_SPREAD)
    rows, prediction = item.who[known], item.prediction
    guide.positions[known], guide.shifts[known] = prediction.positions[rows], prediction.velocities[rows]
    guide.spreads[known] += CHOICE_SPEED * prediction.ages[rows]
    guide.firm[known] = prediction.firm[rows]
    return guide


def observed_views(found: Candidates, precision: Array) -> Array:
    """(P, V, J) whether the 2D person of each view shows joint j, from the precisions (D, J) of 2D joints."""
    member = found.member[..., None]
    if not len(precision):
        return np.zeros(found.source.shape, bool)
    usable: Array = (member >= 0) & (precision[np.maximum(member, 0), found.source] > 0.0)
    return usable


def view_sources(
    detections: DetectionSet, evidence: Evidence, found: Candidates, solved: SolvedJoints, kept: Array
) -> ViewSources:
    """The record for those of the people solved that were kept (P,)."""
    views = [detections.views[slot] for slot in evidence.slots]
    rows = main_people(evidence.starts, found.member[kept], solved.residuals[kept], solved.picks[kept])
    known = np.concatenate([evidence.rows, [-1]])  # -1 stays -1
    frames = np.array([view.frame_number for view in views], np.int64)
    return ViewSources(tuple(view.camera for view in views), frames, known[rows])


@njit(cache=True, error_model="numpy")
def main_people(starts, member, residuals, picks):
    """Row (P, V) of the 2D person of each view that gave most joints to each skeleton, -1 = none.

    Detectors mix people up where they overlap, so that somebody's joints can come from two 2D people of one
    view. A view where association found no 2D person has none, even if single joints of others were used.

    Args:
        starts: (V + 1,) first row of each view. member: (P, V) row that association gave, -1 = none; it
            wins where another gave as many, and where no joint of the view was used.
        residuals: (P, J, V), -1 = unused. picks: (P, J, V, 2) row and joint. See `SolvedJoints`.
    """
    people, joints, views = residuals.shape
    given = np.zeros(starts[-1])  # joints, by each 2D person
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
