"""What known occluders and depth maps are worth: votes of true joints, nodes and people, with and without."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

import numpy as np

from panoptic_ros.bench.stage1.recorded import recorded_world
from panoptic_ros.bench.stage1.rows import of_poses
from panoptic_ros.bench.stage1.world import World, truth_of
from panoptic_ros.domain import DetectionSet, ProposalSet
from panoptic_ros.errors import UsageError
from panoptic_ros.evaluation import SkeletonFrame, SkeletonSequence, evaluate
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.pipeline import records_of
from panoptic_ros.simulation import SCENES, SKELETON, simulate
from panoptic_ros.stage import Progress, StageContext, each, untold
from panoptic_ros.voting.scene import build_scene
from panoptic_ros.voting.votes import at_rest, vote_points

Array = np.ndarray
SIMULATED = "rooms-4p31v"
NEAR = 0.1  # m, a node so near to a true joint of its kind is right
# Every instant by itself, and all nodes: with guidance, a person who was found once is found again anyhow.
ALONE = {
    "voting": {"explain_away": False, "without_maps": True},
    "association": {"temporal_guidance": False},
}
TABLE = (
    ("vote of true joints", "vote", 3),
    ("  of their lowest tenth", "vote_low", 3),
    ("joints with a node", "node_recall", 3),
    ("nodes of no joint", "node_ghosts", 1),
    ("person recall", "person_recall", 3),
    ("person precision", "person_precision", 3),
    ("joint recall", "joint_recall", 3),
    ("MPJPE, mm", "mpjpe_mm", 2),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the bench."""
    parser.add_argument("--frames", type=int, default=20, metavar="N", help="default 20")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the simulation")
    bag = parser.add_argument_group("a recording in place of the simulation")
    bag.add_argument("--bag", metavar="DIR", help="that `panoptic run` wrote, of cameras with depth")
    bag.add_argument("--truth", metavar="FILE", help="true skeletons")


def measure(args: argparse.Namespace, progress: Progress = untold) -> dict[str, Any]:
    """The same views as they are, and as if nothing hid anything.

    Raises:
        UsageError: if one of --bag and --truth is missing, or there are no frames.
        DataError: if the recording cannot be read.
    """
    if args.frames < 1 or bool(args.bag) != bool(args.truth):
        raise UsageError("give --bag and --truth together, and frames from 1")
    world = _world(args)
    bare = tuple(
        replace(item, views=tuple(replace(view, limit=None) for view in item.views)) for item in world.sets
    )
    blind = replace(world, rig=replace(world.rig, occluders=None), sets=bare)
    kinds = (("unknown", blind), ("known", world))
    return {
        "bench": "visibility",
        "source": args.bag or f"{SIMULATED}, seed {args.seed}",
        "frames": len(world.sets),
        "views": len(world.rig),
        "rows": [
            {"occlusion": name, **_row(kind)} for name, kind in each(kinds, len(kinds), progress, "solving")
        ],
    }


def lines(result: dict[str, Any]) -> list[str]:
    """The table."""
    head = f"{result['source']}: {result['frames']} instants of {result['views']} views, each by itself"
    rows = result["rows"]
    out = [head, "", f"{'what hides people is':<26}" + "".join(f"{row['occlusion']:>10}" for row in rows)]
    for title, key, digits in TABLE:
        out.append(f"{title:<26}" + "".join(f"{row[key]:>10.{digits}f}" for row in rows))
    return out


def _world(args: argparse.Namespace) -> World:
    if args.bag:
        return recorded_world(args.bag, None, args.truth, args.frames, None)
    take = simulate(SCENES[SIMULATED], args.seed, args.frames)
    return World(take.rig, SKELETON, tuple(take.detection_sets()), (), truth_of(take))


def _row(world: World) -> dict[str, float]:
    context, configs = StageContext(world.rig, world.skeleton), configure(ALONE)
    proposals = records_of("proposals", world.sets, configs, context, ("association", "voting"))
    poses = records_of("poses", proposals, configs, context, ("assembly",))
    stamps = {item.stamp_ns for item in world.sets}
    assert world.truth is not None  # both kinds of world have one
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
        **{key: scores[key] for _, key, _ in TABLE[4:]},
    }


def _joints(frame: SkeletonFrame) -> tuple[Array, Array]:
    """Which joints (N,) are where (N, 3) m, of people who count."""
    assert frame.ignored is not None  # the record fills it in
    positions = frame.positions[~frame.ignored]
    there = np.isfinite(positions[..., 0])
    return np.nonzero(there)[1], positions[there]


def _votes(world: World, item: DetectionSet, frame: SkeletonFrame) -> Array:
    """Eq. 1 at the true joints; association has set the views' limits."""
    cameras = [world.rig.camera(view.camera) for view in item.views]
    joints, places = _joints(frame)
    scene = build_scene(cameras, item.views, len(world.skeleton))
    votes: Array = vote_points(scene, joints, places, at_rest(places, scene), 0.1)[0]
    return votes


def _hits(item: ProposalSet, frame: SkeletonFrame) -> tuple[Array, int]:
    """Which true joints have a node near, and how many nodes have no true joint near."""
    joints, places = _joints(frame)
    gaps = np.linalg.norm(places[:, None] - item.nodes[None], axis=-1)
    near = (gaps < NEAR) & (joints[:, None] == item.node_joints[None])
    return near.any(axis=1), int((~near.any(axis=0)).sum())
