"""Two easy instants to compile kernels with, so that the first real one does not wait for it."""
from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from panoptic_ros.domain import DetectionSet, Rig, SkeletonModel, ViewDetections

VIEWS = 4  # at most
STEP_NS = 33_000_000


def easy_instants(rig: Rig, skeleton: SkeletonModel) -> Iterator[DetectionSet]:
    """A cloud of joints of a person's size where the first cameras look, and the same a moment later."""
    cameras = rig.cameras[:VIEWS]
    axes = np.stack([camera.cam_from_world.rotation[2] for camera in cameras])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    centres = np.stack([camera.centre for camera in cameras])
    ahead = across.sum(axis=0) + 0.01 * np.eye(3)
    pull = 0.01 * (centres + 4.0 * axes).mean(axis=0)  # for cameras that look the same way
    middle = np.linalg.solve(ahead, np.einsum("cij,cj->i", across, centres) + pull)
    cloud = middle + np.random.default_rng(0).uniform(-0.4, 0.4, (len(skeleton), 3))
    for index in range(2):
        views = []
        for camera in cameras:
            pixels, seen = camera.project(cloud)
            scores = np.where(seen, 0.9, 0.0)[None]
            pixels = np.where(seen[:, None], pixels, np.nan)[None]
            views.append(
                ViewDetections(
                    camera.name, index * STEP_NS, index, camera.image_size, skeleton.hash, pixels, scores,
                    scores.max(axis=1),
                )
            )  # fmt: skip
        yield DetectionSet(index, index * STEP_NS, skeleton.hash, tuple(views))
