"""People before the final solve: associated with predictions, or new."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.assembly.solve import Guide, sources
from panoptic_ros.domain import AssociationSet, Groups
from panoptic_ros.solving.scene import Scene

Array = np.ndarray

CHOICE_SPREAD = 0.03  # m, standard deviation of a prediction of a joint that was just measured
CHOICE_SPEED = 0.6  # m/s, its growth with the time since the measurement


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """P people for the final solve.

    Args:
        grouping: the 2D person of each view. source: (P, V, J) which of its joints stands for joint j.
        guide: their predictions. who: (P,) index of the prediction, -1 = new.
        places: (P, J, 3) m, first estimate of their joints, NaN = unknown.
    """

    grouping: Groups
    source: Array
    guide: Guide
    who: Array
    places: Array

    def joined(self, other: Candidates) -> Candidates:
        """These people and the others."""
        if not len(other.who):
            return self
        names = ("positions", "spreads", "shifts", "firm")
        pairs = ((getattr(self.guide, name), getattr(other.guide, name)) for name in names)
        return Candidates(
            self.grouping.joined(other.grouping),
            np.concatenate([self.source, other.source]),
            Guide(*(np.concatenate(pair) for pair in pairs)),
            np.concatenate([self.who, other.who]),
            np.concatenate([self.places, other.places]),
        )


def associated_people(scene: Scene, item: AssociationSet) -> Candidates:
    """The people of an association: those who were predicted are guided, new ones are not."""
    known = item.who >= 0
    guide = _no_guide(len(known), scene)
    rows, prediction = item.who[known], item.prediction
    guide.positions[known], guide.shifts[known] = prediction.positions[rows], prediction.velocities[rows]
    guide.spreads[known] = CHOICE_SPREAD + CHOICE_SPEED * prediction.ages[rows]
    guide.firm[known] = prediction.firm[rows]
    return Candidates(item.groups, sources(item.groups.mirrored, scene.mirror), guide, item.who, item.places)


def _no_guide(count: int, scene: Scene) -> Guide:
    """A guide without predictions for `count` people."""
    shape = (count, len(scene.mirror), 3)
    spreads, firm = np.full(shape[:2], CHOICE_SPREAD), np.zeros(shape[:2], bool)
    return Guide(np.full(shape, np.nan), spreads, np.zeros(shape), firm)
