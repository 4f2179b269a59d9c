"""Rows of this project's stages: voting on maps, assembly, tracking, refinement."""
from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from panoptic_ros.bench.stage1.rows import Rows, of_poses, only
from panoptic_ros.domain import DetectionSet, ProposalSet
from panoptic_ros.stage import StageContext
from panoptic_ros.voting.box_search import BoxSearch
from panoptic_ros.voting.config import VotingConfig
from panoptic_ros.voting.proposals import Nodes
from panoptic_ros.voting.scene import VoteScene, build_scene
from panoptic_ros.voting.score_volume import Peaks, dense_peaks
from panoptic_ros.voting.stage import VotingStage
from panoptic_ros.voting.volume import Volume

THRESHOLD, VIEW_THRESHOLD, ENOUGH, MIN_VIEWS = 0.1, 0.1, 2, 3  # of the searches of the whole volume
VOXEL = 0.04  # m


def voting_rows(rows: Rows, dense: bool) -> None:
    """Every way to vote, on the maps; `dense` and `exact` must find the same."""
    world = rows.world
    volume = Volume.between(world.bounds, VOXEL)
    boxes = BoxSearch()

    def scene(item: DetectionSet) -> VoteScene:
        cameras = [world.rig.camera(view.camera) for view in item.views]
        return build_scene(cameras, item.views, len(world.skeleton))

    def exact(item: DetectionSet) -> Peaks:
        return boxes.peaks(scene(item), volume, THRESHOLD, VIEW_THRESHOLD, ENOUGH, MIN_VIEWS)

    def every_voxel(item: DetectionSet) -> Peaks:
        return dense_peaks(scene(item), volume, THRESHOLD, VIEW_THRESHOLD, ENOUGH)

    note = f"threshold {THRESHOLD}, {MIN_VIEWS} views"
    found = rows.run("voting", "exact, coarse to fine", exact, world.sets, note=note)
    if dense:
        little = Volume.between((0, 0, 0, 1, 1, 1), 0.25)
        dense_peaks(scene(world.sets[0]), little, 0.9, 0.9, ENOUGH)  # compiles
        expected = rows.run(
            "voting", "dense (baseline)", every_voxel, world.sets, note=note, warmed=True
        )
        same = all(_equal(a, b) for a, b in zip(expected, found))
        rows.rows[-1]["equal_to_exact"] = same
    for method, more in (("seeds", False), ("seeds, explain away", True)):
        stage = rows.stage("voting", {"voting": {"method": "seeds", "explain_away": more}})
        rows.run("voting", method, stage.step, world.sets)
    watched = WatchedVoting(VotingConfig(), StageContext(world.rig, world.skeleton))
    for item in world.sets:
        watched.step(item)
    rows.run("voting", "of which after explaining away", watched.again, watched.left)


class WatchedVoting(VotingStage):
    """The stage, which remembers what explaining away left to be searched."""

    def __init__(self, config: VotingConfig, context: StageContext):
        self.left: list[tuple[Any, ...]] = []
        super().__init__(config, context)

    def reset(self) -> None:
        """As the stage's."""
        super().reset()
        self.left.clear()

    def unexplained(self, *given: Any) -> Nodes:
        """As the stage's."""
        self.left.append(given)
        return super().unexplained(*given)

    def again(self, given: tuple[Any, ...]) -> Nodes:
        """The search of what was left, alone."""
        return super().unexplained(*given)


def _equal(dense: Peaks, exact: Peaks) -> bool:
    """Whether the searches found the same joints, voxels, votes and support."""
    kept = dense.support >= MIN_VIEWS
    return all(np.array_equal(a[kept], b) for a, b in zip(dense, exact))


def people_rows(rows: Rows) -> None:
    """From 2D people to skeletons, without maps."""
    plain = _proposals(rows, {"voting": {"method": "off"}}, rows.world.sets)
    poses = _assemble(rows, "consensus, guided", {"temporal_guidance": True}, plain)
    _follow(rows, poses)
    _assemble(rows, "consensus, every instant alone", {"temporal_guidance": False}, plain)


def _assemble(
    rows: Rows, method: str, parameters: dict[str, Any], proposals: Sequence[ProposalSet], note: str = ""
) -> list[Any]:
    stage = rows.stage("assembly", {"assembly": parameters})
    return rows.run("assembly", method, lambda item: only(stage.step(item)), proposals, of_poses, note)


def _follow(rows: Rows, poses: Sequence[Any]) -> None:
    """Tracking and refinement of what assembly gave."""
    tracking, stage = rows.stage("tracking", {}), rows.stage("refinement", {})
    tracked = rows.run("tracking", "default", lambda item: only(tracking.step(item)), poses)
    results = rows.run("refinement", "default", stage.step, tracked)
    outputs = [output for result in [*results, stage.flush()] for output in result.outputs]
    rows.rows[-1] |= rows.quality([of_poses(output) for output in outputs])


def mapped_rows(rows: Rows) -> None:
    """From score maps to skeletons: the whole of stage one, and the paper's dynamic programming."""
    sets = rows.world.sets
    voting, assembly = rows.stage("voting", {}), rows.stage("assembly", {})
    rows.run(
        "whole stage", "voting and assembly, from maps",
        lambda item: only(assembly.step(only(voting.step(item)))), sets, of_poses,
    )  # fmt: skip
    paper = {"method": "dynamic_programming"}
    seeds = {"method": "seeds", "explain_away": False}
    proposals = _proposals(rows, {"voting": seeds, "assembly": paper}, sets)
    _assemble(rows, "dynamic programming (paper)", paper, proposals, "from nodes of seeds")


def _proposals(rows: Rows, settings: Any, sets: Sequence[DetectionSet]) -> list[ProposalSet]:
    stage = rows.stage("voting", settings)
    return [only(stage.step(item)) for item in sets]
