"""Table rows of this project's stages: voting on score maps, assembly, tracking, refinement."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from panoptic_ros.domain import AssociationSet, DetectionSet, PoseSet, ProposalSet
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.pipeline import records_of
from panoptic_ros.stage import StageContext
from panoptic_ros.study.stage1.dense import dense_nodes
from panoptic_ros.study.stage1.rows import Rows, Settings, of_poses, only
from panoptic_ros.voting.config import VotingConfig
from panoptic_ros.voting.exact import maxima
from panoptic_ros.voting.proposals import NodeCriteria, NodeProposals
from panoptic_ros.voting.scene import VoteScene, build_scene
from panoptic_ros.voting.stage import VotingStage
from panoptic_ros.voting.volume import Volume

# score threshold, views and view threshold of the searches over the whole volume
WANTED = NodeCriteria(0.1, 3, 0.1)
VOXEL = 0.04  # m


def voting_rows(rows: Rows, dense: bool) -> None:
    """Add a row for every voting method on score maps; `dense` and `exact` must find the same nodes."""
    world = rows.world
    volume = Volume.between(world.bounds, VOXEL)

    def scene(item: DetectionSet) -> VoteScene:
        cameras = [world.rig.camera(view.camera) for view in item.views]
        return build_scene(cameras, item.views, len(world.skeleton))

    def exact(item: DetectionSet) -> NodeProposals:
        return maxima(scene(item), volume, WANTED)

    def every_voxel(item: DetectionSet) -> NodeProposals:
        return dense_nodes(scene(item), volume, WANTED)

    note = f"threshold {WANTED.threshold}, {WANTED.min_views} views"
    found = rows.run("voting", "exact, coarse to fine", exact, world.sets, note=note)
    if dense:
        little = Volume.between((0, 0, 0, 1, 1, 1), 0.25)
        dense_nodes(scene(world.sets[0]), little, WANTED)  # compile the kernels
        expected = rows.run("voting", "dense (baseline)", every_voxel, world.sets, note=note, warmed=True)
        same = (np.array_equal(a, b) for pair in zip(expected, found) for a, b in zip(*pair))
        rows.rows[-1]["equal_to_exact"] = all(same)
    associations = _associations(rows)
    for method, more in (("seeds", False), ("seeds, explain away", True)):
        stage = rows.stage("voting", {"voting": {"method": "seeds", "explain_away": more}})
        rows.run("voting", method, stage.step, associations)
    watched = WatchedVoting(VotingConfig(), StageContext(world.rig, world.skeleton))
    for item in associations:
        watched.step(item)
    rows.run("voting", "of which after explaining away", watched.again, watched.left)


class WatchedVoting(VotingStage):
    """Voting stage that stores the inputs of the search after explaining away."""

    def __init__(self, config: VotingConfig, context: StageContext):
        self.left: list[tuple[Any, ...]] = []
        super().__init__(config, context)

    def reset(self) -> None:
        """Reset the stage and forget the stored inputs."""
        super().reset()
        self.left.clear()

    def unexplained(self, *given: Any) -> NodeProposals:
        """Store the input, then search as the stage does."""
        self.left.append(given)
        return super().unexplained(*given)

    def again(self, given: tuple[Any, ...]) -> NodeProposals:
        """Repeat the search for unexplained nodes on a stored input, without the other parts of the stage."""
        return super().unexplained(*given)


class FeedbackChain:
    """Association, voting and assembly of one set, with feedback from tracking.

    Args:
        maps: vote on score maps; False = use 2D poses alone.
    """

    def __init__(self, rows: Rows, settings: Settings, maps: bool):
        self._association = rows.stage("association", settings)
        self._assembly = rows.stage("assembly", settings)
        self._voting = rows.stage("voting", settings) if maps else None
        self._tracking = rows.stage("tracking", settings)
        self._last: PoseSet | None = None

    def __call__(self, item: DetectionSet) -> PoseSet:
        """Return the skeletons of a set."""
        found: AssociationSet = only(self._association.step(item))
        proposals = ProposalSet.of_nothing(found)
        if self._voting is not None:
            proposals = only(self._voting.step(found))
        poses: PoseSet = only(self._assembly.step(proposals))
        self._last = poses
        return poses

    def following(self, sets: Sequence[DetectionSet]) -> Iterator[DetectionSet]:
        """Yield the sets; after each set, feed its tracks back to association.

        Tracking runs outside the timed call.
        """
        for item in sets:
            yield item
            if self._last is not None and self._last.stamp_ns == item.stamp_ns:
                _, tracks = self._tracking.step(self._last).outputs
                self._association.step(tracks)


def people_rows(rows: Rows) -> None:
    """Add the rows from 2D poses to skeletons, without score maps."""
    poses = _assemble(rows, "from 2D people, guided", {})
    _follow(rows, poses)
    _assemble(rows, "every instant alone", {"association": {"temporal_guidance": False}})


def _assemble(rows: Rows, method: str, settings: Settings, maps: bool = False, note: str = "") -> list[Any]:
    """Add a row of association and assembly, or of all stage one with score maps; return its results."""
    fed = FeedbackChain(rows, settings, maps)
    step = "whole stage" if maps else "assembly"
    return rows.run(step, method, fed, fed.following(rows.world.sets), of_poses, note)


def _follow(rows: Rows, poses: Sequence[Any]) -> None:
    """Add the rows of tracking and refinement on the assembled poses."""
    tracking, stage = rows.stage("tracking", {}), rows.stage("refinement", {})
    tracked = rows.run("tracking", "default", lambda item: tracking.step(item).outputs[0], poses)
    results = rows.run("refinement", "default", stage.step, tracked)
    outputs = [output for result in [*results, stage.flush()] for output in result.outputs]
    rows.rows[-1] |= rows.quality([of_poses(output) for output in outputs])


def mapped_rows(rows: Rows) -> None:
    """Add the rows from score maps to skeletons: all of stage one, and the paper's dynamic programming."""
    _assemble(rows, "voting and assembly, from maps", {}, maps=True)
    paper = {"assembly": {"method": "dynamic_programming"}}
    seeds = {"voting": {"method": "seeds", "explain_away": False}}
    _assemble(rows, "dynamic programming (paper)", seeds | paper, maps=True, note="from nodes of seeds")


def _associations(rows: Rows) -> list[AssociationSet]:
    """Return the associations of all sets from the association stage of the graph."""
    context = StageContext(rows.world.rig, rows.world.skeleton)
    return records_of("associations", rows.world.sets, configure({}), context)
