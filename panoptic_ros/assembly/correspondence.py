"""One-to-one correspondence of 3D joints and 2D joints (Joo et al. 2017, 5.3)."""
from __future__ import annotations

import numpy as np

from panoptic_ros.domain import DetectionSet, Rig

Array = np.ndarray


class Correspondence:
    """The 2D joints of one instant near its 3D nodes; each can be claimed once.

    Args:
        nodes: (N, 3) m. joints: (N,) which joint each node is.
        gate: m, how far a 2D joint may be from the projection of its node, measured at the node's depth.
            (The paper's 10 px of its VGA images are 3 to 5 cm.)
        min_score: 2D joints with lower scores cannot be claimed.
    """

    def __init__(
        self,
        detections: DetectionSet,
        rig: Rig,
        nodes: Array,
        joints: Array,
        gate: float,
        min_score: float = 0.0,
    ):
        views = detections.views
        most = max((len(view.points) for view in views), default=0)
        count = max([int(joints.max(initial=-1)) + 1, *(view.points.shape[1] for view in views)])
        self._joints = np.asarray(joints, np.int64)
        self._free = np.zeros((count, len(views), most), bool)
        self._distances = np.full((len(nodes), len(views), most), np.inf)  # m; infinite beyond the gate
        for v, view in enumerate(views):
            people = len(view.points)
            known = (view.scores > 0.0) & (view.scores >= min_score)
            self._free[: known.shape[1], v, :people] = known.T
            camera = rig.camera(view.camera)
            pixels, seen = camera.project(nodes)
            depth = nodes @ camera.cam_from_world.rotation[2] + camera.cam_from_world.translation[2]
            focal = 0.5 * np.trace(camera.intrinsics.matrix[:2, :2])
            away = np.linalg.norm(view.points[:, self._joints].swapaxes(0, 1) - pixels[:, None], axis=-1)
            away *= (depth / focal)[:, None]
            near = seen[:, None] & known[:, self._joints].T & (away < gate)  # False for NaN
            self._distances[:, v, :people] = np.where(near, away, np.inf)
        self._near = np.isfinite(self._distances)

    def claims_of(self, nodes: Array) -> Array:
        """The free 2D person (K, V) whose joint is closest to each of the nodes (K,); -1 = none is near."""
        if self._free.shape[2] == 0:
            return np.full((len(nodes), self._free.shape[1]), -1, np.int64)
        distances = np.where(self._free[self._joints[nodes]], self._distances[nodes], np.inf)
        best = distances.argmin(axis=-1)
        return np.where(np.isfinite(distances.min(axis=-1)), best, -1)

    def claim(self, nodes: Array, claims: Array) -> None:
        """Nobody else can claim the 2D joints (K, V) of these nodes (K,) from now on."""
        row, view = np.nonzero(claims >= 0)
        self._free[self._joints[nodes[row]], view, claims[row, view]] = False

    def taken(self, min_views: int) -> Array:
        """Which nodes (N,) are explained by what others claimed.

        They have 2D joints near them in `min_views` views, but free ones in fewer.
        """
        left = (self._near & self._free[self._joints]).any(axis=-1).sum(axis=-1)
        lost: Array = (self._near.any(axis=-1).sum(axis=-1) >= min_views) & (left < min_views)
        return lost
