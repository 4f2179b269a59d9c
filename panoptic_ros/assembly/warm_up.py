"""An example to compile the kernels with, so that the first real instant does not wait for it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from panoptic_ros.domain import ProposalSet, Rig, ScoreMaps, SkeletonModel
from panoptic_ros.solving.example import beside, cloud_of_joints, easy_associations

DELAY_NS = 1000  # between views, so that they have stamps of their own


def example_sets(rig: Rig, skeleton: SkeletonModel) -> Iterator[ProposalSet]:
    """Instants of a cloud of joints: of one view; of more, without maps; with maps, its nodes and parts, and
    nodes beside it.

    So people are found in every way that there is: by bones, by 2D people, by guidance, by parts, by nodes.
    """
    _, few = easy_associations(rig.subset(rig.names[:2]), skeleton)
    member, lengths = few.groups.member.copy(), np.full((1, len(skeleton.bones)), np.nan)
    member[:, 1:] = -1
    yield ProposalSet.of_nothing(
        replace(
            few,
            groups=replace(few.groups, member=member),
            prediction=replace(few.prediction, lengths=lengths),
        )
    )
    joints = np.arange(len(skeleton))
    cells = np.zeros((len(joints), 2))
    maps = ScoreMaps((1, 1), np.eye(2, 3), joints, 0 * joints - 1, cells, cells + 1, np.full(len(joints), 9))
    cloud = cloud_of_joints(rig, skeleton)
    nodes, ones = np.concatenate([cloud, cloud + beside(rig)]), np.ones(2 * len(joints))
    parts = np.array(skeleton.bones).reshape(-1, 2)
    first, second = easy_associations(rig, skeleton, DELAY_NS)
    yield ProposalSet.of_nothing(first)
    views = tuple(replace(view, maps=maps) for view in second.detections.views)
    second = replace(second, detections=replace(second.detections, views=views))
    yield ProposalSet(
        second,
        nodes,
        np.tile(joints, 2),
        0.9 * ones,
        4 * ones,
        parts,
        np.arange(len(parts)),
        np.full(len(parts), 0.9),
    )
