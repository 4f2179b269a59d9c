"""A rig of three cameras, views without people, and what a stage makes of them."""

from __future__ import annotations

import numpy as np
import pytest

from panoptic_ros.domain import Camera, Rig, SkeletonModel, ViewDetections
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.stage import StageContext
from panoptic_ros.sync import SyncConfig, SyncStage

SKELETON = SkeletonModel("dot", ("a", "b"), 0, ((0, 1),), 0)
K = Intrinsics(np.array([[100.0, 0, 50], [0, 100, 50], [0, 0, 1]]), np.zeros(5))


class Bench:
    """Builders, so that test files need no imports from each other."""

    skeleton = SKELETON

    def context(self, cameras="abc"):
        return StageContext(Rig(tuple(Camera(n, (100, 100), K, Rigid.identity()) for n in cameras)), SKELETON)

    def stage(self, cameras="abc", **parameters):
        return SyncStage(SyncConfig(**parameters), self.context(cameras))

    def view(self, camera, stamp, number=0, points=None):
        points = np.zeros((0, 2, 2)) if points is None else np.asarray(points, float)
        scores = np.where(np.isfinite(points).all(-1), 0.8, 0.0)
        return ViewDetections(
            camera, round(stamp), number, (100, 100), SKELETON.hash, points, scores, np.full(len(points), 0.8)
        )

    def run(self, sync, items):
        """[(index, stamp, ((camera, stamp of its view), ...))] and the codes of all notices."""
        results = [sync.step(item) for item in items] + [sync.flush()]
        sets = [s for r in results for s in r.outputs]
        codes = [n.code for r in results for n in r.notices]
        return [(s.index, s.stamp_ns, tuple((v.camera, v.stamp_ns) for v in s.views)) for s in sets], codes


@pytest.fixture
def bench():
    return Bench()
