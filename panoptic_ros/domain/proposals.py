"""What voting gives: node proposals and part scores."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain.association import AssociationSet
from panoptic_ros.domain.checks import Shapes, check_scores
from panoptic_ros.domain.detections import DetectionSet
from panoptic_ros.errors import DataError

Array = np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class ProposalSet:
    """3D node proposals and scored parts of one instant (Joo et al. 2017, 5.1 and 5.2).

    Args:
        association: the people that were known, so that assembly needs nothing else.
        nodes: (N, 3) m, putative joint positions in the world.
        node_joints: (N,) joint of each node.
        node_scores: (N,) in 0..1, the vote of eq. 1.
        node_views: (N,) number of views that support the node.
        parts: (M, 2) nodes (of the parent joint, of the child joint).
        part_bones: (M,) index into `SkeletonModel.bones`; -1 = a part across one missing joint.
        part_scores: (M,) in 0..1, connectivity over the views (5.2).
    """

    association: AssociationSet
    nodes: Array
    node_joints: Array
    node_scores: Array
    node_views: Array
    parts: Array
    part_bones: Array
    part_scores: Array

    def __post_init__(self) -> None:
        shapes = Shapes(self)
        nodes = shapes.store("nodes", np.float64, "N 3")
        shapes.store("node_joints", np.int32, "N")
        check_scores(self, "node_scores", shapes.store("node_scores", np.float64, "N"))
        shapes.store("node_views", np.int32, "N")
        parts = shapes.store("parts", np.int32, "M 2")
        shapes.store("part_bones", np.int32, "M")
        check_scores(self, "part_scores", shapes.store("part_scores", np.float64, "M"))
        if not np.isfinite(nodes).all():
            raise DataError("ProposalSet.nodes is not finite")
        if parts.size and not 0 <= parts.min() <= parts.max() < len(nodes):
            raise DataError("ProposalSet.parts names a node that is not there")

    @classmethod
    def of_nothing(cls, association: AssociationSet) -> ProposalSet:
        """No proposals: nothing but what is known from 2D people."""
        none = np.zeros(0)
        return cls(association, np.zeros((0, 3)), none, none, none, np.zeros((0, 2)), none, none)

    @property
    def of_maps(self) -> bool:
        """Whether the nodes say more than the 2D people that they came with."""
        return len(self.nodes) > 0 and any(view.maps is not None for view in self.detections.views)

    @property
    def detections(self) -> DetectionSet:
        """The detection set behind them."""
        return self.association.detections

    @property
    def index(self) -> int:
        """Index of the detection set."""
        return self.detections.index

    @property
    def stamp_ns(self) -> int:
        """Stamp of the detection set."""
        return self.detections.stamp_ns
