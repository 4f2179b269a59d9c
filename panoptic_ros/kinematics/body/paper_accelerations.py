"""The acceleration term of Malleson et al. 2020, eq. 13: where sites would be by what their IMUs measured."""

from __future__ import annotations

import numpy as np

from panoptic_ros.geometry.chain import Pose, place_all
from panoptic_ros.geometry.segment_chain import Chain
from panoptic_ros.kinematics.imus.devices import WornDevices
from panoptic_ros.kinematics.pose.targets import PointTargets


def acceleration_goals(
    chain: Chain, poses: tuple[Pose, Pose], devices: WornDevices, weight: float, period: float
) -> PointTargets:
    """A site's place that gives the measured acceleration with the two poses before, the older one first."""
    which = np.flatnonzero(devices.accelerated)
    segments, offsets = devices.segments[which], devices.positions[which]
    places, frames = place_all(
        chain, np.stack([pose.root for pose in poses]), np.stack([pose.turns for pose in poses])
    )
    sites = places[:, segments] + (frames[:, segments] @ offsets[..., None])[..., 0]
    information = weight / period**4 * np.tile(np.eye(3), (len(which), 1, 1))
    goals = 2.0 * sites[1] - sites[0] + period**2 * devices.pushes[which]
    return PointTargets(segments, offsets, goals, information, 1.0)
