"""Views of a target: pixels of its points in one image, and the tables that the adjustment needs of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from panoptic_ros.calibration.bundle import Observations
from panoptic_ros.calibration.projection import POSE

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


def image_speeds(views: Sequence[TargetView], times: Array) -> list[Array]:
    """Return the image velocity (K, 2) px/s of the points of each view; 0 without a neighbour in time.

    It is the slope, at the view, of the parabola through the views before and after in the same camera. At an
    end it is the difference to one of them.

    Args:
        times: (V,) s, of each view.
    """
    order = sorted(range(len(views)), key=lambda k: (views[k].camera, times[k]))
    speeds = [np.zeros((len(view.numbers), 2)) for view in views]
    for place, k in enumerate(order):
        steps, slopes = [], []
        for n in (place - 1, place + 1):
            if not 0 <= n < len(order) or views[order[n]].camera != views[k].camera:
                continue
            step = times[order[n]] - times[k]
            if 0.0 < abs(step) <= LONGEST_STEP_S:
                steps.append(step)
                slopes.append(_changes(views[k], views[order[n]]) / step)
        if len(steps) == 2:
            before, after = steps
            slope = (after * slopes[0] - before * slopes[1]) / (after - before)
            one = np.where(np.isfinite(slopes[0]), slopes[0], slopes[1])
            slope = np.where(np.isfinite(slope), slope, one)
        elif steps:
            slope = slopes[0]
        else:
            continue
        if np.isfinite(slope).any():  # points that the neighbours lack move like the others
            speeds[k][:] = np.where(np.isfinite(slope), slope, np.nanmedian(slope, axis=0))
    return speeds


def _changes(view: TargetView, other: TargetView) -> Array:
    """Return the motion (K, 2) px of the points of a view to another view; NaN where that lacks the point."""
    found = np.full((len(view.numbers), 2), np.nan)
    _, own, their = np.intersect1d(view.numbers, other.numbers, return_indices=True)
    found[own] = other.pixels[their] - view.pixels[own]
    return found


def observations_of(views: Sequence[TargetView], points: Array, noise: Array) -> Observations:
    """Return the observations of views of a target at rest, sorted by instant, then camera.

    Args:
        views: at least one; their instants are 0 to B - 1, each used at least once.
        points: (N, 3) m, points of the target.
        noise: (C,) px, standard deviation per axis of the pixels of each camera.
    """
    order = in_order(views)
    sizes = [len(views[k].numbers) for k in order]
    targets = np.array([views[k].instant for k in order])
    cameras = np.array([views[k].camera for k in order])
    stamps = np.array([views[k].stamp_s for k in order])
    middle = np.bincount(targets, weights=stamps) / np.bincount(targets)
    numbers = np.concatenate([views[k].numbers for k in order])
    return Observations(
        cameras=cameras,
        targets=targets,
        starts=np.concatenate([[0], np.cumsum(sizes)]),
        firsts=np.searchsorted(targets, np.arange(int(targets.max()) + 2)),
        numbers=numbers,
        points=np.ascontiguousarray(points[numbers], dtype=np.float64),
        pixels=np.concatenate([views[k].pixels for k in order]).astype(np.float64),
        variances=np.repeat(noise[cameras] ** 2, sizes),
        delays=stamps - middle[targets],
        twists=np.zeros((int(targets.max()) + 1, POSE)),
    )


def in_order(views: Sequence[TargetView]) -> list[int]:
    """Return the indices of views sorted by instant, then camera."""
    return sorted(range(len(views)), key=lambda k: (views[k].instant, views[k].camera))
