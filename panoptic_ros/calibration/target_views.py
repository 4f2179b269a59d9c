"""Views of a target: pixels of its points in one image, and the tables that the adjustment needs of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from panoptic_ros.calibration.bundle import Observations

Array = np.ndarray
LONGEST_STEP_S = 0.5  # s, time between two images beyond which they give no image velocity


@dataclass(frozen=True, eq=False)
class TargetView:
    """Target at one instant in one image.

    Args:
        camera: index of the camera.
        instant: index of the instant, common to all cameras.
        stamp_s: s, stamp of the image.
        numbers: (K,) points of the target, each at most once.
        pixels: (K, 2) px.
    """

    camera: int
    instant: int
    stamp_s: float
    numbers: Array
    pixels: Array


def image_speeds(views: Sequence[TargetView]) -> list[Array]:
    """Return the image velocity (K, 2) px/s of the points of each view; 0 without a neighbour in time.

    It is the difference of the views before and after in the same camera; at an end, that of one of them.
    """
    order = sorted(range(len(views)), key=lambda k: (views[k].camera, views[k].stamp_s))
    speeds = [np.zeros((len(view.numbers), 2)) for view in views]
    for place, k in enumerate(order):
        around = [order[n] for n in (place - 1, place + 1) if 0 <= n < len(order)]
        near = [
            n
            for n in around
            if views[n].camera == views[k].camera
            and 0.0 < abs(views[n].stamp_s - views[k].stamp_s) <= LONGEST_STEP_S
        ]
        ends = [views[near[0]], views[near[-1]]] if len(near) == 2 else [views[k], *(views[n] for n in near)]
        if len(ends) < 2:
            continue
        first, last = ends
        _, here, there = np.intersect1d(first.numbers, last.numbers, return_indices=True)
        if not len(here):
            continue
        change = (last.pixels[there] - first.pixels[here]) / (last.stamp_s - first.stamp_s)
        common = first.numbers[here]
        speeds[k][:] = np.median(change, axis=0)  # points that a neighbour lacks move like the others
        _, own, their = np.intersect1d(views[k].numbers, common, return_indices=True)
        speeds[k][own] = change[their]
    return speeds


def observations_of(
    views: Sequence[TargetView], points: Array, noise: Array, speeds: Sequence[Array] | None = None
) -> Observations:
    """Return the observations of views, sorted by instant, then camera.

    Args:
        views: at least one; their instants are 0 to B - 1, each used at least once.
        points: (N, 3) m, points of the target.
        noise: (C,) px, standard deviation per axis of the pixels of each camera.
        speeds: image velocity of the points of each view; None = still. It moves the pixels to the mean stamp
            of the instant.
    """
    order = sorted(range(len(views)), key=lambda k: (views[k].instant, views[k].camera))
    sizes = [len(views[k].numbers) for k in order]
    targets = np.array([views[k].instant for k in order])
    cameras = np.array([views[k].camera for k in order])
    numbers = np.concatenate([views[k].numbers for k in order])
    moving = [np.zeros((size, 2)) for size in sizes] if speeds is None else [speeds[k] for k in order]
    stamps = np.array([views[k].stamp_s for k in order])
    middle = np.bincount(targets, weights=stamps) / np.maximum(np.bincount(targets), 1)
    pixels = [views[k].pixels + speed * (middle[views[k].instant] - views[k].stamp_s) for k, speed in zip(order, moving)]
    return Observations(
        cameras=cameras,
        targets=targets,
        starts=np.concatenate([[0], np.cumsum(sizes)]),
        firsts=np.searchsorted(targets, np.arange(int(targets.max()) + 2)),
        numbers=numbers,
        points=np.ascontiguousarray(points[numbers], dtype=np.float64),
        pixels=np.concatenate(pixels).astype(np.float64),
        speeds=np.concatenate(moving),
        variances=np.repeat(noise[cameras] ** 2, sizes),
    )
