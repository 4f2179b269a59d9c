"""How much smaller or larger the errors of 2D joints are than was assumed, learnt from one person's motion.

Detectors and images differ: one `joint_sd` does not fit them all. The residuals of the pose that is solved
tell. Their median square is hardly touched by outliers. A pose takes on some of the errors, so they are a
little small.
"""

from __future__ import annotations

import math

import numpy as np

from panoptic_ros.geometry.chain import Pose, place_all
from panoptic_ros.geometry.segment_chain import Chain
from panoptic_ros.kinematics.pose.targets import ViewTargets

Array = np.ndarray
MEDIAN = 2.0 * math.log(2.0)  # of the squared length of two normal residuals of variance 1
FEWEST = 20  # residuals that tell something
LOOK_S, MEMORY_S, BELIEF = 0.1, 1.0, 1  # s; looks for which what is assumed counts at first
LEAST, MOST = 0.25, 4.0  # shares of what is assumed
NEAREST = 0.1  # m before a camera


class NoiseLevel:
    """The level of one person's residuals; 1 = as assumed."""

    def __init__(self) -> None:
        self._square = 1.0
        self._looks = 0
        self._since = LOOK_S

    @property
    def level(self) -> float:
        """The standard deviation of 2D joints as a share of what was assumed."""
        return min(max(math.sqrt(self._square), LEAST), MOST)

    def learn(self, views: ViewTargets, chain: Chain, pose: Pose, seconds: float) -> None:
        """Look at the residuals of a pose now and then, so many seconds after the pose before.

        Args:
            views: weighed by the level as it is now.
        """
        self._since += seconds
        if len(views.segments) < FEWEST or self._since < LOOK_S:
            return
        places, frames = place_all(chain, pose.root[None], pose.turns[None])
        sites = places[0, views.segments] + (frames[0, views.segments] @ views.offsets[..., None])[..., 0]
        turned = (views.rotations[views.cameras] @ sites[..., None])[..., 0]
        local = turned + views.translations[views.cameras]
        apart = local[:, :2] / np.maximum(local[:, 2:], NEAREST) - views.points
        square = float(np.median(views.weights * (apart**2).sum(axis=-1))) / MEDIAN * self.level**2
        self._looks += 1
        self._square += (square - self._square) * max(1.0 / (self._looks + BELIEF), LOOK_S / MEMORY_S)
        self._since = 0.0
