"""Two simple instants that compile kernels in advance, so that the first real instant does not wait."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from panoptic_ros.domain import (
    AssociationSet,
    DetectionSet,
    Groups,
    Prediction,
    Rig,
    SkeletonModel,
    ViewDetections,
)
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.solving.scene import gather

Array = np.ndarray
VIEWS = 4  # maximum number of views
STEP_NS = 33_000_000  # ns, time between the two instants
SPREAD = 0.4  # m, half the extent of a cloud of a person's size along each axis
INSIDE = 0.25  # upper limit of the extent of the cloud, as a share of half an image: small rigs see all of it


def cloud_of_joints(rig: Rig, skeleton: SkeletonModel) -> Array:
    """Return joints (J, 3) m, world, at the point where the first cameras look.

    The cloud has the size of a person, or less if the cameras see less.
    """
    middle, spread = _place(rig)
    cloud: Array = middle + np.random.default_rng(0).uniform(-spread, spread, (len(skeleton), 3))
    return cloud


def beside(rig: Rig) -> float:
    """Return the offset, m along each axis, of points beside the cloud."""
    return 1.75 * _place(rig)[1]


def _place(rig: Rig) -> tuple[Array, float]:
    """Return the centre (3,) m, world, of the cloud and half its extent along each axis, m.

    The centre is the point nearest to the optical axes of the first cameras (least squares).
    """
    cameras = rig.cameras[:VIEWS]
    axes = np.stack([camera.cam_from_world.rotation[2] for camera in cameras])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    centres = np.stack([camera.centre for camera in cameras])
    ahead = across.sum(axis=0) + 0.01 * np.eye(3)
    pull = 0.01 * (centres + 4.0 * axes).mean(axis=0)  # prior 4 m ahead: parallel axes have no nearest point
    middle = np.linalg.solve(ahead, np.einsum("cij,cj->i", across, centres) + pull)
    depths = ((middle - centres) * axes).sum(axis=1)
    halves = [0.5 * min(c.image_size) / c.intrinsics.matrix[:2, :2].diagonal().max() for c in cameras]
    return middle, float(np.clip((INSIDE * depths * halves).min(), 0.01, SPREAD))


def easy_instants(rig: Rig, skeleton: SkeletonModel, delay_ns: int = 0) -> Iterator[DetectionSet]:
    """Yield two detection sets that show a cloud of joints and one joint beside it in the first cameras.

    Both sets show the same joints, STEP_NS apart. Only joints inside an image are detected, so the cameras of
    any rig could produce these sets. The joint beside the cloud is not a person, so its 2D joints stay
    unexplained.

    Args:
        delay_ns: ns, delay of the timestamp of each view after that of the view before, in the second set.
    """
    people = np.full((2, len(skeleton), 3), np.nan)
    people[0] = cloud_of_joints(rig, skeleton)
    people[1, -1] = people[0, -1] + beside(rig)
    for index in range(2):
        views = []
        for number, camera in enumerate(rig.cameras[:VIEWS]):
            pixels, seen = camera.project(people.reshape(-1, 3))
            seen &= camera.contains(pixels)  # distortion may move points far outside into the image
            scores = np.where(seen, 0.9, 0.0).reshape(2, -1)
            pixels = np.where(seen[:, None], pixels, np.nan).reshape(2, -1, 2)
            views.append(
                ViewDetections(
                    camera.name,
                    index * (STEP_NS + number * delay_ns),
                    index,
                    camera.image_size,
                    skeleton.hash,
                    pixels,
                    scores,
                    scores.max(axis=1),
                )
            )
        yield DetectionSet(index, index * STEP_NS, skeleton.hash, tuple(views))


def easy_associations(rig: Rig, skeleton: SkeletonModel, delay_ns: int = 0) -> Iterator[AssociationSet]:
    """Yield the same two instants with the cloud associated over the views: first a new person, then a track.

    Args:
        delay_ns: See `easy_instants`.
    """
    arrays, cloud = RigArrays.of(rig), cloud_of_joints(rig, skeleton)[None]
    ages, still = np.zeros(cloud.shape[:2]), np.zeros_like(cloud)
    for item in easy_instants(rig, skeleton, delay_ns):
        evidence = gather(item, arrays, skeleton, skeleton.hash, 0.0)
        counts = (evidence.scores > 0.0).sum(axis=1)
        rows = [int(start + counts[start:end].argmax()) for start, end in pairwise(evidence.starts)]
        groups = Groups(np.array(rows, np.int64)[None], np.zeros((1, len(rows)), bool))
        known = item.index > 0
        prediction = Prediction(cloud, still, ages, 1e-3 + still, ages < 0.0)
        yield AssociationSet(
            item,
            evidence,
            groups,
            np.array([0 if known else -1]),
            cloud,
            prediction if known else Prediction.of_nobody(len(skeleton)),
        )
