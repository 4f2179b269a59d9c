"""Worlds with other skeletons, for the growth of time with the number of joints.

This module also maps recordings to skeletons that lack some of the recorded joints.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from panoptic_ros.domain import DetectionSet, JointMap, ScoreMaps, SkeletonModel, ViewDetections
from panoptic_ros.evaluation import SkeletonFrame, SkeletonSequence
from panoptic_ros.io.skeletons import load_skeleton, map_joints, shared_names
from panoptic_ros.simulation import CLEAN, SimulatedScene, simulate
from panoptic_ros.simulation.drawn_maps import with_drawn_maps
from panoptic_ros.simulation.timing import to_stamp
from panoptic_ros.simulation.whole_body import named_joints, project_joints
from panoptic_ros.study.stage1.layouts import ACTIVITIES, layout_of
from panoptic_ros.study.world import World

NOISE_PX = 2.0  # standard deviation of the 2D joints, px


def any_skeleton_world(name: str, people: int, views: int, frames: int, seed: int) -> World:
    """Simulate persons with the joints of a skeleton model, with pixel noise, score maps and no occlusion."""
    skeleton, layout = load_skeleton(name), layout_of(views, people)
    activities = tuple(np.resize(ACTIVITIES, people).tolist())
    take = simulate(
        SimulatedScene("bench", activities, layout.rig, area=layout.area, degradation=CLEAN), seed, frames
    )
    ticks = take.schedule.ticks
    joints = np.stack([named_joints(p, ticks, shared_names(name)) for p in take.people], axis=1)
    ids = np.arange(people)
    sets = [
        project_joints(take.rig, skeleton, rows, index, tick, NOISE_PX, seed)
        for index, (tick, rows) in enumerate(zip(ticks, joints))
    ]
    truth = [SkeletonFrame(to_stamp(tick), ids, rows) for tick, rows in zip(ticks, joints)]
    return World(
        take.rig,
        skeleton,
        tuple(with_drawn_maps(item, layout.maps) for item in sets),
        layout.bounds,
        SkeletonSequence(skeleton.joint_names, tuple(truth)),
    )


def in_joints_of(world: World, name: str) -> World:
    """Map a world to the joints of another skeleton model.

    Raises:
        ConfigError: if there is no model of this name, or it has none of the world's joints.
    """
    skeleton, joint_map = map_joints(name, world.skeleton.joint_names)
    sets = tuple(set_in_joints(item, skeleton, joint_map) for item in world.sets)
    return replace(world, skeleton=skeleton, sets=sets)


def set_in_joints(item: DetectionSet, skeleton: SkeletonModel, joint_map: JointMap) -> DetectionSet:
    """Map a detection set to the joints of another skeleton model.

    Args:
        joint_map: map from the set's joints to those of `skeleton`.
    """

    def mapped(view: ViewDetections) -> ViewDetections:
        points, scores = joint_map.apply(view.points, view.scores)
        maps = None if view.maps is None else maps_of(view.maps, joint_map)
        return replace(view, skeleton_hash=skeleton.hash, points=points, scores=scores, maps=maps)

    views = tuple(mapped(view) for view in item.views)
    return replace(item, skeleton_hash=skeleton.hash, views=views)


def maps_of(maps: ScoreMaps, joint_map: JointMap) -> ScoreMaps:
    """Return the score maps of those joints that the joint map copies from one source joint."""
    new = np.full(joint_map.source_count, -1)
    for joint, sources in enumerate(joint_map.sources):
        if len(sources) == 1:
            new[sources[0]] = joint
    kept = new[maps.joints] >= 0
    lengths = maps.sizes.prod(axis=1)
    return replace(
        maps,
        joints=new[maps.joints[kept]],
        persons=maps.persons[kept],
        corners=maps.corners[kept],
        sizes=maps.sizes[kept],
        data=maps.data[np.repeat(kept, lengths)],
    )
