"""The voting stage."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import Camera, DetectionSet, ProposalSet, ViewDetections
from panoptic_ros.errors import DataError
from panoptic_ros.stage import StageContext, StepResult
from panoptic_ros.voting import soft_vote
from panoptic_ros.voting.box_search import BoxSearch
from panoptic_ros.voting.config import VotingConfig
from panoptic_ros.voting.parts import bones_and_skips, score_parts
from panoptic_ros.voting.scene import VoteScene, build_scene
from panoptic_ros.voting.score_volume import Peaks, dense_peaks
from panoptic_ros.voting.seeds import SeedSearch
from panoptic_ros.voting.volume import Volume, volume_of_rig

Array = np.ndarray


class Demands(NamedTuple):
    """What a node proposal needs: votes above `threshold`, and so many supporting views."""

    threshold: float
    min_views: int


def demands(config: VotingConfig, view_count: int) -> Demands:
    """The demands of the configuration, or those that suit the number of views."""
    if view_count <= 7:
        threshold, min_views = 0.06, 2
    elif view_count <= 15:
        threshold, min_views = 0.1, 3
    else:
        threshold, min_views = 0.05, 3
    return Demands(config.threshold or threshold, config.min_views or min_views)


class VotingStage:
    """`DetectionSet` to `ProposalSet` (Joo et al. 2017, 5.1 and 5.2)."""

    def __init__(self, config: VotingConfig, context: StageContext):
        """Derives the volume and compiles the kernels.

        Raises:
            ConfigError: if the configured volume is no box.
        """
        self.config, self.rig, self.skeleton = config, context.rig, context.skeleton
        if config.volume:
            self.volume = Volume.between(config.volume, config.voxel)
        elif config.method in ("exact", "dense"):
            self.volume = volume_of_rig(context.rig, config.voxel)
        else:
            self.volume = Volume.everywhere(config.voxel)
        skip = config.max_skip if config.skip_parts else None
        self._kinds = bones_and_skips(context.skeleton, config.max_bone, skip)
        self._search = SeedSearch(config.ray_gap, config.pair_views, config.max_depth)
        self._boxes = BoxSearch()
        self._order = {name: k for k, name in enumerate(context.rig.names)}
        if config.method != "off":
            self._propose((), ())

    def step(self, item: DetectionSet) -> StepResult[ProposalSet]:
        """Vote on one instant.

        Raises:
            DataError: if the set speaks of other cameras, image sizes or joints than the context.
        """
        self._check(item)
        if self.config.method == "off":
            return StepResult((_proposals(item),))
        views = sorted(item.views, key=lambda view: self._order[view.camera])
        cameras = [self.rig.cameras[self._order[view.camera]] for view in views]
        return StepResult((_proposals(item, *self._propose(tuple(cameras), tuple(views))),))

    def flush(self) -> StepResult[ProposalSet]:
        """Nothing is buffered."""
        return StepResult()

    def reset(self) -> None:
        """Nothing is remembered."""

    def _propose(
        self, cameras: tuple[Camera, ...], views: tuple[ViewDetections, ...]
    ) -> tuple[Array, ...]:
        """The arrays of a `ProposalSet` after its detections."""
        config = self.config
        scene = build_scene(
            cameras, views, len(self.skeleton), config.keypoint_width, config.person_gate
        )
        wanted = demands(config, len(views))
        peaks = self._peaks(scene, cameras, wanted)
        peaks = Peaks(*(values[peaks.support >= wanted.min_views] for values in peaks))
        nodes, votes = self.volume.centres(peaks.voxels), peaks.votes
        kept = np.arange(len(nodes))
        if config.refine_nodes:
            nodes, votes = soft_vote.refine(nodes, peaks.joints, scene)
            kept = distinct(nodes, peaks.joints, votes, config.merge_distance)
        nodes, joints, votes = nodes[kept], peaks.joints[kept], votes[kept]
        parts, bones, scores = score_parts(scene, nodes, joints, self._kinds, config.part_threshold)
        return nodes, joints, np.clip(votes, 0.0, 1.0), peaks.support[kept], parts, bones, scores

    def _peaks(self, scene: VoteScene, cameras: tuple[Camera, ...], wanted: Demands) -> Peaks:
        config = self.config
        enough = min(2, wanted.min_views)
        if config.method == "dense":
            return dense_peaks(
                scene, self.volume, wanted.threshold, config.view_threshold, enough
            )
        if config.method == "exact":
            return self._boxes.peaks(
                scene, self.volume, wanted.threshold, config.view_threshold, enough, wanted.min_views
            )
        return self._search.peaks(
            scene, cameras, self.volume, wanted.threshold, config.view_threshold, enough, wanted.min_views
        )

    def _check(self, item: DetectionSet) -> None:
        if item.skeleton_hash != self.skeleton.hash:
            raise DataError(
                f"detection set {item.index} speaks of skeleton {item.skeleton_hash}, "
                f"voting was made for {self.skeleton.name} ({self.skeleton.hash})"
            )
        for view in item.views:
            if view.camera not in self._order:
                raise DataError(f"detection set {item.index} has camera {view.camera}, the rig has not")
            camera = self.rig.cameras[self._order[view.camera]]
            if view.image_size != camera.image_size:
                raise DataError(
                    f"camera {view.camera} gives images of {view.image_size[0]} x {view.image_size[1]}, "
                    f"the rig says {camera.image_size[0]} x {camera.image_size[1]}"
                )
            joints = [view.points.shape[1]]
            if view.maps is not None and view.maps.joints.size:
                joints.append(int(view.maps.joints.max()) + 1)
            if joints[0] != len(self.skeleton) or max(joints) > len(self.skeleton):
                raise DataError(
                    f"camera {view.camera} speaks of {max(joints)} joints, {self.skeleton.name} has "
                    f"{len(self.skeleton)}"
                )


def distinct(nodes: Array, joints: Array, votes: Array, distance: float) -> Array:
    """Indices of nodes to keep: of those of one joint within a distance, the one with most votes."""
    kept: list[int] = []
    for joint in np.unique(joints):
        mine = np.flatnonzero(joints == joint)
        mine = mine[np.lexsort([*nodes[mine].T, -votes[mine]])]
        near = np.linalg.norm(nodes[mine][:, None] - nodes[mine][None], axis=-1) < distance
        free = np.ones(len(mine), bool)
        for k in range(len(mine)):
            if free[k]:
                kept.append(int(mine[k]))
                free &= ~near[k]
    return np.array(sorted(kept), np.int64)


def _proposals(item: DetectionSet, *arrays: Array) -> ProposalSet:
    if arrays:
        return ProposalSet(item, *arrays)
    return ProposalSet(item, np.zeros((0, 3)), (), (), (), np.zeros((0, 2)), (), ())
