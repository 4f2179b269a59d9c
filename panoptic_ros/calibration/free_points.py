"""Free points of the bundle adjustment: targets of one point without known coordinates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from panoptic_ros.calibration.bundle import Adjustment, CameraStates, Observations, Targets
from panoptic_ros.calibration.projection import POSE

Array = np.ndarray


def points_seen(cameras: Array, points: Array, pixels: Array, variance: float) -> Observations:
    """Return the observations of free points of synchronous cameras.

    Args:
        cameras, points: (M,) of each observation, sorted by point, then camera; points are 0 to B - 1.
        pixels: (M, 2) px. variance: px^2.
    """
    count = len(points)
    total = int(points[-1]) + 1
    return Observations(
        cameras=cameras,
        targets=points,
        starts=np.arange(count + 1),
        firsts=np.searchsorted(points, np.arange(total + 1)),
        numbers=np.zeros(count, np.int64),
        points=np.zeros((count, 3)),
        pixels=np.ascontiguousarray(pixels),
        variances=np.full(count, variance),
        delays=np.zeros(count),
        twists=np.zeros((total, POSE)),
    )


def points_at(positions: Array) -> Targets:
    """Return free points at positions (B, 3) m."""
    return Targets(np.tile(np.eye(3), (len(positions), 1, 1)), positions)


def kept_points(
    seen: Observations, state: Adjustment, good: Array
) -> tuple[Observations, Adjustment, Array, Array]:
    """Return the good observations (M,) of points that two cameras still see.

    Returns:
        observations and state, the mask (M,) of the observations, and the numbers (B',) of the points.
    """
    good = good & (np.bincount(seen.targets, weights=good)[seen.targets] >= 2)
    used, targets = np.unique(seen.targets[good], return_inverse=True)
    count = int(good.sum())
    kept = Observations(
        seen.cameras[good],
        targets,
        np.arange(count + 1),
        np.searchsorted(targets, np.arange(len(used) + 1)),
        seen.numbers[good],
        seen.points[good],
        seen.pixels[good],
        seen.variances[good],
        seen.delays[good],
        seen.twists[used],
    )
    points = Targets(state.targets.rotations[used], state.targets.translations[used])
    return kept, replace(state, targets=points, shifts=np.zeros(count)), good, used


def with_gauge(states: CameraStates) -> CameraStates:
    """Return the cameras with one free length fixed: the longest of all translations."""
    free = states.free.copy()
    camera, axis = np.unravel_index(np.argmax(np.abs(states.translations)), states.translations.shape)
    free[camera, 3 + axis] = False
    return replace(states, free=free)
