"""Scale of a sensor's depth, from depth maps of a board whose pose the calibration gives (section 3.4)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.calibration.solve import CalibratedRig
from panoptic_ros.calibration.target_poses import intrinsics_of

Array = np.ndarray
FEWEST_VIEWS = 5  # views with depth that give a scale with its deviation
CAUCHY = 3.0  # scale of the weights, in standard deviations
ROUNDS = 10  # number of updates of the weights
MAD = 1.4826  # standard deviation of a Gaussian over its median absolute deviation


class SeenDepths(NamedTuple):
    """Depth at the points of a board in one image.

    Args:
        camera: Index of the camera. stamp_s: s, stamp of the image.
        pixels: (K, 2) px. depths: (K,) m along the axis of the camera, 0 or NaN = unknown.
    """

    camera: int
    stamp_s: float
    pixels: Array
    depths: Array


class DepthScale(NamedTuple):
    """Scale of a sensor's depth.

    Args:
        scale: True depth over measured depth. sd: Its standard deviation.
        noise_1m: Noise at a depth of 1 m, m; it grows with the square of depth.
        points: Number of points.
    """

    scale: float
    sd: float
    noise_1m: float
    points: int


def depth_scale(rig: CalibratedRig, camera: int, seen: Sequence[SeenDepths]) -> DepthScale | None:
    """Return the scale of the depth of a camera's sensor; None with too few views.

    True depths are those of the board's plane on the rays of the pixels. The noise of depth grows with the
    square of depth (Khoshelham and Elberink 2012). The deviation of the scale follows from the scatter
    between views, because errors within a view are alike.
    """
    at = {(view.camera, view.stamp_s): view.instant for view in rig.views}
    true, measured, views = [], [], []
    for n, own in enumerate(seen):
        instant = at.get((camera, own.stamp_s)) if own.camera == camera else None
        if instant is None:
            continue
        expected = _plane_depths(rig, camera, instant, own.pixels)
        good = (own.depths > 0.0) & np.isfinite(own.depths) & np.isfinite(expected)
        true.append(expected[good])
        measured.append(own.depths[good])
        views.append(np.full(int(good.sum()), n))
    if len(views) < FEWEST_VIEWS:
        return None
    t, m, owner = np.concatenate(true), np.concatenate(measured), np.concatenate(views)
    if len(np.unique(owner)) < FEWEST_VIEWS:
        return None
    base = 1.0 / t**4  # information of depth, with noise 1 m at 1 m
    scale = float(np.median(t / m))
    noise, weight = 1.0, base
    for _ in range(ROUNDS):
        miss = (t - scale * m) / t**2
        noise = max(MAD * float(np.median(np.abs(miss - np.median(miss)))), 1e-9)
        weight = base / (1.0 + (miss / (CAUCHY * noise)) ** 2)
        scale = float((weight * m * t).sum() / (weight * m * m).sum())
    pulls = np.bincount(owner, weights=weight * m * (t - scale * m))
    sd = float(np.sqrt((pulls**2).sum()) / (weight * m * m).sum())
    return DepthScale(scale, sd, noise, len(t))


def _plane_depths(rig: CalibratedRig, camera: int, instant: int, pixels: Array) -> Array:
    """Return the depths (K,) m of the plane of a target on the rays of pixels (K, 2)."""
    states, targets = rig.state.cameras, rig.state.targets
    plane = intrinsics_of(states.lenses[camera], bool(states.fisheye[camera])).undistort(pixels)
    rotation = states.rotations[camera] @ targets.rotations[instant]
    origin = states.rotations[camera] @ targets.translations[instant] + states.translations[camera]
    normal = rotation[:, 2]
    rays = np.column_stack([plane, np.ones(len(plane))])
    with np.errstate(divide="ignore", invalid="ignore"):
        depths: Array = (normal @ origin) / (rays @ normal)
    return np.where(depths > 0.0, depths, np.nan)
