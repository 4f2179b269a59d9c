"""An example to compile the kernels with, so that the first real instant does not wait for it."""
from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from panoptic_ros.domain import DetectionSet, ProposalSet, Rig, SkeletonModel, ViewDetections

Array = np.ndarray
VIEWS = 4  # that the example has at most


def example_sets(rig: Rig, skeleton: SkeletonModel) -> Iterator[ProposalSet]:
    """Two instants of one person-sized cloud of joints where the cameras look, then not at once."""
    cameras = rig.cameras[:VIEWS]
    cloud = np.random.default_rng(0).uniform(-0.4, 0.4, (len(skeleton), 3)) + _middle(Rig(cameras))
    for index in range(2):
        views = []
        for k, camera in enumerate(cameras):
            pixels, seen = camera.project(cloud)
            scores = np.where(seen, 0.9, 0.0)[None]
            views.append(
                ViewDetections(
                    camera.name, index * (33_000_000 + 1000 * k), index, camera.image_size, skeleton.hash,
                    pixels[None], scores, scores.max(axis=1),
                )
            )  # fmt: skip
        found = DetectionSet(index, index * 33_000_000, skeleton.hash, tuple(views))
        none = np.zeros(0)
        yield ProposalSet(found, none.reshape(0, 3), none, none, none, none.reshape(0, 2), none, none)


def _middle(rig: Rig) -> Array:
    """The point (3,) m closest to all optical axes."""
    axes = np.stack([camera.cam_from_world.rotation[2] for camera in rig.cameras])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    centres = np.stack([camera.centre for camera in rig.cameras])
    normal = across.sum(axis=0) + 1e-6 * np.eye(3)
    middle: Array = np.linalg.solve(normal, np.einsum("cij,cj->i", across, centres))
    return middle
