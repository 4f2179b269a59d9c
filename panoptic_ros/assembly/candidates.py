"""People before the final solve: associated with predictions, or new."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.assembly.config import AssemblyConfig
from panoptic_ros.assembly.limbs import ANATOMY_VOTES, Sides
from panoptic_ros.assembly.solve import Guide, sources
from panoptic_ros.consensus.grouping import Grouping, Scene, assign
from panoptic_ros.consensus.guidance import Prediction
from panoptic_ros.consensus.newcomers import find_people

Array = np.ndarray

CHOICE_SPREAD = 0.03  # m, standard deviation of a prediction of a joint that was just measured
CHOICE_SPEED = 0.6  # m/s, its growth with the time since the measurement


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """P people for the final solve.

    Args:
        grouping: the 2D person of each view. source: (P, V, J) which of its joints stands for joint j.
        guide: their predictions. who: (P,) index of the prediction, -1 = new.
        free: (D,) 2D people that are not associated.
        places: (P, J, 3) m, first estimate of their joints, NaN = unknown.
    """

    grouping: Grouping
    source: Array
    guide: Guide
    who: Array
    free: Array
    places: Array

    def joined(self, other: Candidates) -> Candidates:
        """These people and the others, which were found among the free 2D people of these."""
        if not len(other.who):
            return self
        names = ("positions", "spreads", "shifts", "firm")
        pairs = ((getattr(self.guide, name), getattr(other.guide, name)) for name in names)
        return Candidates(
            self.grouping.joined(other.grouping),
            np.concatenate([self.source, other.source]),
            Guide(*(np.concatenate(pair) for pair in pairs)),
            np.concatenate([self.who, other.who]),
            other.free,
            np.concatenate([self.places, other.places]),
        )


def guided_people(scene: Scene, prediction: Prediction, config: AssemblyConfig) -> Candidates:
    """Predicted people with whom 2D people of two or more views are associated."""
    free = np.ones(len(scene.evidence.view), bool)
    grouping, free = assign(
        scene, prediction.positions, prediction.velocities, free, config, config.guided_agreement
    )
    seen = (grouping.member >= 0).sum(axis=1) >= 2
    free[grouping.member[~seen][grouping.member[~seen] >= 0]] = True
    grouping = Grouping(grouping.member[seen], grouping.mirrored[seen])
    guide = Guide(
        prediction.positions[seen], CHOICE_SPREAD + CHOICE_SPEED * prediction.ages[seen],
        prediction.velocities[seen], prediction.firm[seen],
    )  # fmt: skip
    source = sources(grouping.mirrored, scene.mirror)
    return Candidates(grouping, source, guide, np.flatnonzero(seen), free, guide.positions)


def new_people(scene: Scene, free: Array, sides: Sides, config: AssemblyConfig) -> Candidates:
    """New people among the free 2D people, the right way round."""
    grouping, places = find_people(scene, free, config)
    left = free.copy()
    if len(places):  # seldom
        votes = np.where(grouping.member >= 0, np.where(grouping.mirrored, 1.0, -1.0), 0.0).sum(axis=1)
        votes -= ANATOMY_VOTES * sides.of_body(places)
        grouping.mirrored ^= (votes > 0.0)[:, None]
        left[grouping.member[grouping.member >= 0]] = False
    source = sources(grouping.mirrored, scene.mirror)
    guide = _no_guide(len(places), scene)
    return Candidates(grouping, source, guide, np.full(len(places), -1), left, places)


def _no_guide(count: int, scene: Scene) -> Guide:
    """A guide without predictions for `count` people."""
    shape = (count, len(scene.mirror), 3)
    spreads, firm = np.full(shape[:2], CHOICE_SPREAD), np.zeros(shape[:2], bool)
    return Guide(np.full(shape, np.nan), spreads, np.zeros(shape), firm)
