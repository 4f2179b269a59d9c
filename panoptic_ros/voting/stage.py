"""Voting stage."""

from __future__ import annotations

import numpy as np

from panoptic_ros.domain import AssociationSet, ProposalSet, ViewDetections
from panoptic_ros.domain.of_all import joined, selected
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.solving.example import easy_associations
from panoptic_ros.solving.joint_records import guides_of
from panoptic_ros.solving.scene import check_association
from panoptic_ros.stage import StageContext, StepResult
from panoptic_ros.state import Stateful, StateLayout
from panoptic_ros.voting.config import VotingConfig
from panoptic_ros.voting.exact import maxima
from panoptic_ros.voting.parts import NO_PARTS, score_parts
from panoptic_ros.voting.peaks import KnownNodes
from panoptic_ros.voting.proposals import NodeCriteria, NodeProposals, distinct
from panoptic_ros.voting.scene import VoteScene, build_scene
from panoptic_ros.voting.seeds import nodes_at_seeds
from panoptic_ros.voting.soft_vote import moved
from panoptic_ros.voting.volume import Volume, volume_of_rig
from panoptic_ros.voting.votes import PointMotion

Array = np.ndarray
SURE_VIEWS = 3  # least number of views that support a node which explains peaks away
REACH = 2.0  # standard deviations of a prediction within which the votes of its joint are searched
ONE_PLACE = 0.03  # m; closer nodes of one joint are merged, such as those of people who are detected twice


def demands(config: VotingConfig, view_count: int) -> NodeCriteria:
    """Return the demands of the configuration, with defaults that depend on the number of views."""
    if view_count <= 7:
        threshold, min_views = 0.06, 2
    elif view_count <= 15:
        threshold, min_views = 0.1, 3
    else:
        threshold, min_views = 0.05, 3
    return NodeCriteria(config.threshold or threshold, config.min_views or min_views, config.view_threshold)


class VotingStage(Stateful):
    """Stage from `AssociationSet` to `ProposalSet` (Joo et al. 2017, 5.1 and 5.2), without memory."""

    LAYOUT = StateLayout(
        "voting",
        (),
        (),
        same={"configuration": "config", "cameras": "rig.names", "skeleton": "skeleton.hash"},
    )

    def __init__(self, config: VotingConfig, context: StageContext):
        """Derive the volume and compile the kernels.

        Raises:
            ConfigError: if the configured volume is not a box.
        """
        self.config, self.rig, self.skeleton = config, context.rig, context.skeleton
        self._hash = context.skeleton.hash  # a property that is computed at each call
        if config.volume:
            self.volume = Volume.between(config.volume, config.voxel)
        elif config.method == "exact":
            self.volume = volume_of_rig(context.rig, config.voxel)
        else:
            self.volume = Volume.everywhere(config.voxel)
        self._cameras = {camera.name: camera for camera in context.rig.cameras}
        self._arrays = RigArrays.of(context.rig)
        for example in easy_associations(context.rig, context.skeleton):
            self._vote(example)
        self.reset()

    def step(self, association: AssociationSet) -> StepResult[ProposalSet]:
        """Vote on one instant.

        If no view has score maps, there are no nodes, unless `without_maps` asks for them: they would add
        nothing to the 2D poses.

        Raises:
            DataError: if the people have another skeleton, or cameras that the rig lacks.
        """
        item = association.detections
        check_association(association, self._arrays, self.skeleton, self._hash)
        mapped = self.config.without_maps or any(view.maps is not None for view in item.views)
        if self.config.method == "off" or not mapped:
            return StepResult((ProposalSet.of_nothing(association),))
        return StepResult((self._vote(association),))

    def _vote(self, association: AssociationSet) -> ProposalSet:
        """Return the nodes of an instant and, if configured, the parts between them."""
        item = association.detections
        views = sorted(item.views, key=lambda view: view.camera)  # rays are paired in the order of names
        cameras = [self._cameras[view.camera] for view in views]
        config = self.config
        scene = build_scene(cameras, views, len(self.skeleton))
        wanted = demands(config, sum(has_anything(view) for view in views))
        if config.method == "exact":
            nodes = maxima(scene, self.volume, wanted)
        else:
            middles = [camera.middle_s for camera in cameras]
            since = [1e-9 * (view.stamp_ns - item.stamp_ns) for view in views]
            delays = np.array(since) + np.array(middles)
            known = KnownNodes.of_nobody(delays)
            if config.explain_away:
                known = self._known(scene, wanted, association, delays)
            sure = known.rows(known.nodes.support >= SURE_VIEWS)
            nodes = joined(known.nodes, self.unexplained(scene, wanted, sure))
            nodes = selected(nodes, distinct(nodes.points, nodes.joints, nodes.votes, ONE_PLACE))
        parts = NO_PARTS
        if config.parts:
            parts = score_parts(
                scene, nodes.points, nodes.joints, self.skeleton.bones, config.max_bone, config.part_threshold
            )
        nodes = nodes._replace(votes=np.clip(nodes.votes, 0.0, 1.0))
        return ProposalSet(association, *nodes, *parts)

    def flush(self) -> StepResult[ProposalSet]:
        """Return nothing: the stage buffers no records."""
        return StepResult()

    def reset(self) -> None:
        """Do nothing: the stage has no memory."""

    def _known(
        self, scene: VoteScene, wanted: NodeCriteria, association: AssociationSet, delays: Array
    ) -> KnownNodes:
        """Return nodes at the joints of people, each moved to the centre of the votes round it."""
        guide, places = guides_of(association), association.places
        there = np.isfinite(places[..., 0])
        joints = np.ascontiguousarray(np.nonzero(there)[1])  # kernels are compiled for one memory layout
        velocities = guide.shifts[there]
        moving = PointMotion(velocities, delays, REACH * guide.spreads[there])
        nodes = moved(scene, joints, places[there], wanted.view_threshold, moving)
        return KnownNodes(nodes, velocities, delays).rows(self._good(nodes, wanted))

    def unexplained(self, scene: VoteScene, wanted: NodeCriteria, explainer: KnownNodes) -> NodeProposals:
        """Return nodes from the 2D peaks that known joints do not explain."""
        found = nodes_at_seeds(scene, wanted, explainer)
        return selected(found, self._good(found, wanted))

    def _good(self, nodes: NodeProposals, wanted: NodeCriteria) -> Array:
        """Return which nodes (N,) satisfy the demands and lie in the volume."""
        good = (nodes.votes > wanted.threshold) & (nodes.support >= wanted.min_views)
        inside: Array = good & self.volume.contains(nodes.points)
        return inside


def has_anything(view: ViewDetections) -> bool:
    """Return whether a view has detections or maps: blind cameras must not raise the demands on a node."""
    return len(view.points) > 0 or (view.maps is not None and len(view.maps.joints) > 0)
