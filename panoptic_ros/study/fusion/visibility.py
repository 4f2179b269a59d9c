"""The study `visibility`: votes, nodes and persons with and without known occluders and depth maps."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from panoptic_ros.domain import DetectionSet, ProposalSet
from panoptic_ros.errors import UsageError
from panoptic_ros.evaluation import SkeletonFrame, SkeletonSequence, evaluate
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.pipeline import records_of
from panoptic_ros.running.arguments import within
from panoptic_ros.simulation import SCENES, SKELETON, simulate
from panoptic_ros.stage import Progress, StageContext
from panoptic_ros.study.options import add_seeds
from panoptic_ros.study.stage1.rows import of_poses
from panoptic_ros.study.study import Case, Column, Result, Row, Study
from panoptic_ros.study.world import World, bag_world, truth_of
from panoptic_ros.voting.scene import build_scene
from panoptic_ros.voting.votes import at_rest, vote_points

Array = np.ndarray
SIMULATED = "rooms-4p31v"
NEAR = 0.1  # m, a node this close to a true joint of its type is correct
# Solve every set independently and keep all nodes. With temporal guidance, a person who was detected once is
# found again even without knowledge of the occlusion.
ALONE = {
    "voting": {"explain_away": False, "without_maps": True},
    "association": {"temporal_guidance": False},
}
FIGURES = ("person_recall", "person_precision", "joint_recall", "mpjpe_mm")


class Visibility(Study):
    """The same views as they are, and as if nothing hid anything.

    The second case solves without the known occluders and without the visibility limits of the views.
    """

    columns = (
        Column("occlusion", "what hides people is"),
        Column("vote", "vote of true joints", ".3f"),
        Column("vote_low", "  of their lowest tenth", ".3f"),
        Column("node_recall", "joints with a node", ".3f"),
        Column("node_ghosts", "nodes of no joint", ".1f"),
        *(Column(key, key.replace("_", " "), ".3f") for key in FIGURES[:3]),
        Column("mpjpe_mm", "MPJPE, mm", ".2f"),
    )
    across = True

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        parser.add_argument(
            "--frames",
            type=within(int, 1, 10**6),
            default=20,
            metavar="N",
            help="number of frames; default 20",
        )
        add_seeds(parser, "0")
        bag = parser.add_argument_group("a recording instead of the simulation")
        bag.add_argument("--bag", type=Path, metavar="DIR", help="bag of `panoptic run`, with depth")
        bag.add_argument("--truth", type=Path, metavar="FILE", help="true skeletons")

    def cases(self) -> list[Case]:
        """See `Study`."""
        if bool(self.options.bag) != bool(self.options.truth):
            raise UsageError("give --bag and --truth together")
        if self.options.bag:
            return [Case(str(self.options.bag))]
        return [Case(f"{SIMULATED}, seed {seed}", seed) for seed in self.options.seeds]

    def measure(self, case: Case, progress: Progress) -> Iterator[Row]:
        """See `Study`."""
        given = self.options
        if given.bag:
            world = bag_world(given.bag, (), given.truth, given.frames)
        else:
            take = simulate(SCENES[SIMULATED], case.request, given.frames)
            world = World(take.rig, SKELETON, tuple(take.detection_sets()), (), truth_of(take))
        bare = tuple(
            replace(item, views=tuple(replace(view, limit=None) for view in item.views))
            for item in world.sets
        )
        blind = replace(world, rig=replace(world.rig, occluders=None), sets=bare)
        about = {"source": case.title, "frames": len(world.sets), "views": len(world.rig)}
        for name, kind in (("unknown", blind), ("known", world)):
            yield about | {"occlusion": name} | _row(kind)

    def head(self, result: Result) -> str:
        """See `Study`."""
        row = result["rows"][0]
        return f"{row['source']}: {row['frames']} instants of {row['views']} views, each by itself"


def _row(world: World) -> dict[str, float]:
    context, configs = StageContext(world.rig, world.skeleton), configure(ALONE)
    proposals = records_of("proposals", world.sets, configs, context, ("association", "voting"))
    poses = records_of("poses", proposals, configs, context, ("assembly",))
    stamps = {item.stamp_ns for item in world.sets}
    assert world.truth is not None  # true for both worlds
    names = world.skeleton.joint_names
    truth = SkeletonSequence(
        names, tuple(f for f in world.truth.with_joints(names).frames if f.stamp_ns in stamps)
    )
    at = {frame.stamp_ns: frame for frame in truth.frames}
    pairs = [(item, at[item.stamp_ns]) for item in proposals if item.stamp_ns in at]
    votes = np.concatenate([_votes(world, item.detections, frame) for item, frame in pairs])
    hits = [_hits(item, frame) for item, frame in pairs]
    scores = evaluate(truth, SkeletonSequence(names, tuple(map(of_poses, poses)))).to_mapping()
    return {
        "vote": float(votes.mean()),
        "vote_low": float(np.quantile(votes, 0.1)),
        "node_recall": float(np.concatenate([found for found, _ in hits]).mean()),
        "node_ghosts": float(np.mean([ghosts for _, ghosts in hits])),
        **{key: scores[key] for key in FIGURES},
    }


def _joints(frame: SkeletonFrame) -> tuple[Array, Array]:
    """Return joint indices (N,) and positions (N, 3) m of the true joints of persons who are not ignored."""
    assert frame.ignored is not None  # the constructor fills it in
    positions = frame.positions[~frame.ignored]
    there = np.isfinite(positions[..., 0])
    return np.nonzero(there)[1], positions[there]


def _votes(world: World, item: DetectionSet, frame: SkeletonFrame) -> Array:
    """Return the votes (eq. 1) at the true joints.

    The association stage has already set the visibility limits of the views.
    """
    cameras = [world.rig.camera(view.camera) for view in item.views]
    joints, places = _joints(frame)
    scene = build_scene(cameras, item.views, len(world.skeleton))
    votes: Array = vote_points(scene, joints, places, at_rest(places, scene), 0.1)[0]
    return votes


def _hits(item: ProposalSet, frame: SkeletonFrame) -> tuple[Array, int]:
    """Match true joints and nodes of the same type within `NEAR`.

    Returns:
        flags (N,) of true joints with a node, and the number of nodes without a true joint.
    """
    joints, places = _joints(frame)
    gaps = np.linalg.norm(places[:, None] - item.nodes[None], axis=-1)
    near = (gaps < NEAR) & (joints[:, None] == item.node_joints[None])
    return near.any(axis=1), int((~near.any(axis=0)).sum())
