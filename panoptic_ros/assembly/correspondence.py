"""One-to-one correspondence of 3D joints and 2D joints (Joo et al. 2017, 5.3)."""
from __future__ import annotations

import numpy as np

from panoptic_ros.domain import Camera, DetectionSet, Rig

Array = np.ndarray


class Correspondence:
    """The 2D joints of one instant, each of which can be claimed once.

    Args:
        gate: m, how far a 2D joint may be from the projection of its 3D joint, measured at the depth of
            the joint. (The paper's 10 px of its VGA images are 3 to 5 cm.)
        min_score: 2D joints with lower scores cannot be claimed.
    """

    def __init__(self, detections: DetectionSet, rig: Rig, gate: float, min_score: float = 0.0):
        views = detections.views
        self.cameras: list[Camera] = [rig.camera(view.camera) for view in views]
        self.gate = gate
        most = max((len(view.points) for view in views), default=0)
        joints = max((view.points.shape[1] for view in views), default=0)
        self._points = np.full((len(views), joints, most, 2), np.nan)  # NaN = missing or claimed
        for v, view in enumerate(views):
            known = (view.scores > 0.0) & (view.scores >= min_score)
            points = np.where(known[..., None], view.points, np.nan)
            self._points[v, :, : len(points)] = points.swapaxes(0, 1)
        focals = [0.5 * np.trace(camera.intrinsics.matrix[:2, :2]) for camera in self.cameras]
        self._focals = np.array(focals).reshape(-1)

    def nearest(self, joints: Array) -> Array:
        """The 2D person (J, V) whose joint is closest to each of the 3D joints (J, 3) m; -1 = none.

        Missing joints are NaN. Nothing is claimed yet.
        """
        claims = np.full((len(joints), len(self.cameras)), -1, np.int64)
        if self._points.shape[2] == 0:
            return claims
        there = np.isfinite(joints).all(-1)
        places = np.where(there[:, None], joints, 0.0)
        for v, camera in enumerate(self.cameras):
            pixels, seen = camera.project(places)
            depth = places @ camera.cam_from_world.rotation[2] + camera.cam_from_world.translation[2]
            distance = np.linalg.norm(self._points[v] - pixels[:, None], axis=-1)
            distance = np.where(np.isnan(distance), np.inf, distance)
            best = distance.argmin(axis=1)
            reach = self.gate * self._focals[v] / np.maximum(depth, 1e-3)
            near = there & seen & (distance[np.arange(len(joints)), best] < reach)
            claims[near, v] = best[near]
        return claims

    def claim(self, claims: Array) -> None:
        """Nobody else can claim these (J, V) 2D joints from now on."""
        joint, view = np.nonzero(claims >= 0)
        self._points[view, joint, claims[joint, view]] = np.nan
