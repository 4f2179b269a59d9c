"""One-to-one correspondence of 3D joints and 2D joints (Joo et al. 2017, 5.3)."""
from __future__ import annotations

import numpy as np

from panoptic_ros.domain import DetectionSet, Rig

Array = np.ndarray
VGA = (640, 480)  # px


class Correspondence:
    """The 2D joints of one instant near its 3D nodes; each can be claimed once.

    Args:
        nodes: (N, 3) m. joints: (N,) which joint each node is.
        gate_px: how far a 2D joint may be from the projection of its node, in an image of 640 x 480; in
            others it is the same share of the diagonal. (The paper: 10 px in such images.)
    """

    def __init__(self, detections: DetectionSet, rig: Rig, nodes: Array, joints: Array, gate_px: float):
        views = detections.views
        most = max((len(view.points) for view in views), default=0)
        count = max([int(joints.max(initial=-1)) + 1, *(view.points.shape[1] for view in views)])
        self._joints = np.asarray(joints, np.int64)
        self._free = np.zeros((count, len(views), most), bool)
        self._distances = np.full((len(nodes), len(views), most), np.inf)  # px; infinite beyond the gate
        for v, view in enumerate(views):
            known = view.scores > 0.0
            self._free[: known.shape[1], v, : len(known)] = known.T
            pixels, seen = rig.camera(view.camera).project(nodes)
            away = np.linalg.norm(view.points[:, self._joints].swapaxes(0, 1) - pixels[:, None], axis=-1)
            gate = gate_px * float(np.hypot(*view.image_size) / np.hypot(*VGA))
            near = seen[:, None] & known[:, self._joints].T & (away < gate)  # False for NaN
            self._distances[:, v, : len(known)] = np.where(near, away, np.inf)

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
