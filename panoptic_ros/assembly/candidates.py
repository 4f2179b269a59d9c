"""People before the final solve: associated with predictions, or new."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain import AssociationSet, Groups
from panoptic_ros.solving.joint_records import Guides, guides_of, sources
from panoptic_ros.solving.scene import Scene

Array = np.ndarray



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
    guide: Guides
    who: Array
    places: Array

    def joined(self, other: Candidates) -> Candidates:
        """These people and the others."""
        if not len(other.who):
            return self
        return Candidates(
            self.grouping.joined(other.grouping),
            np.concatenate([self.source, other.source]),
            Guides(*(np.concatenate(pair) for pair in zip(self.guide, other.guide))),
            np.concatenate([self.who, other.who]),
            np.concatenate([self.places, other.places]),
        )


def associated_people(scene: Scene, item: AssociationSet) -> Candidates:
    """The people of an association: those who were predicted are guided, new ones are not."""
    guide = guides_of(item)
    return Candidates(item.groups, sources(item.groups.mirrored, scene.mirror), guide, item.who, item.places)
