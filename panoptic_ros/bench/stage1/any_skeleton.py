"""Worlds of other skeletons: the growth of time with the number of joints."""
from __future__ import annotations

import numpy as np

from panoptic_ros.bench.stage1.world import ACTIVITIES, World, layout_of
from panoptic_ros.evaluation import SkeletonFrame, SkeletonSequence
from panoptic_ros.io.skeletons import load_skeleton, shared_names
from panoptic_ros.simulation import CLEAN, Scene, simulate
from panoptic_ros.simulation.drawn_maps import with_drawn_maps
from panoptic_ros.simulation.timing import to_stamp
from panoptic_ros.simulation.whole_body import named_joints, project_joints

NOISE_PX = 2.0


def any_skeleton_world(name: str, people: int, views: int, frames: int, seed: int) -> World:
    """People in the joints of a skeleton model, seen with noise, nobody hidden; with maps."""
    skeleton, layout = load_skeleton(name), layout_of(views, people)
    activities = tuple(np.resize(ACTIVITIES, people).tolist())
    take = simulate(Scene("bench", activities, layout.rig, area=layout.area, degradation=CLEAN), seed, frames)
    ticks = take.schedule.ticks
    joints = np.stack([named_joints(p, ticks, shared_names(name)) for p in take.people], axis=1)
    ids = np.arange(people)
    sets = [
        project_joints(take.rig, skeleton, rows, index, tick, NOISE_PX, seed)
        for index, (tick, rows) in enumerate(zip(ticks, joints))
    ]
    truth = [SkeletonFrame(to_stamp(tick), ids, rows) for tick, rows in zip(ticks, joints)]
    return World(
        take.rig, skeleton, tuple(with_drawn_maps(item, layout.maps) for item in sets), layout.bounds,
        SkeletonSequence(skeleton.joint_names, tuple(truth)),
    )
