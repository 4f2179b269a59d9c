"""Lens of a camera from its own views of a planar target: Zhang's closed form, then an adjustment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from panoptic_ros.calibration.bundle import Adjustment, CameraStates, Targets, adjust
from panoptic_ros.calibration.projection import CAMERA, LENS, POSE
from panoptic_ros.calibration.target_poses import intrinsics_of, poses_of
from panoptic_ros.calibration.target_views import TargetView, observations_of

Array = np.ndarray
FEWEST_POINTS = 8  # points of a view that Zhang's form uses
PLAUSIBLE = (0.2, 10.0)  # focal length over the longer side of the image
BLIND = (0.6, 0.8, 1.0, 1.4)  # focal lengths to try, over the longer side, without Zhang's form
MOST_VIEWS = 40  # views that start a lens, evenly spaced
NOISE_PX = 1.0  # px, first noise of the pixels
START_SCALE = 3.0  # scale of the Cauchy weights, in standard deviations
# standard deviations of priors: aspect of pixels, principal point (px over the longer side), distortion.
# All are two to three times the spread of the lenses of labs.
SD_ASPECT, SD_CENTRE, SD_RADIAL, SD_TANGENTIAL = 0.02, 0.03, 1.0, 0.02
SD_FISHEYE = 0.3


@dataclass(frozen=True)
class LensModel:
    """Lens model of a camera, and the terms of it that are estimated.

    Args:
        fisheye: whether the lens is a fisheye of OpenCV.
        terms: number of terms of distortion: 5 (Brown) or 8 (rational); 4 for a fisheye.
    """

    fisheye: bool = False
    terms: int = 5

    @property
    def free(self) -> Array:
        """Return the entries (12,) of a lens that are estimated."""
        return np.arange(LENS) < 4 + self.terms


def lens_prior(size: tuple[int, int], focal: float, model: LensModel) -> tuple[Array, Array]:
    """Return the expected lens (12,) and its information (12, 12), given an approximate focal length, px.

    The focal length itself has no prior, only its aspect: fx and fy are nearly equal.
    """
    width, height = size
    lens = np.zeros(LENS)
    lens[:4] = focal, focal, 0.5 * (width - 1), 0.5 * (height - 1)
    sd = np.full(LENS, np.inf)
    sd[2:4] = SD_CENTRE * max(size)
    sd[4:] = SD_FISHEYE if model.fisheye else SD_RADIAL
    if not model.fisheye:
        sd[6:8] = SD_TANGENTIAL
    information = np.diag(1.0 / sd**2)
    information[:2, :2] += np.array([[1.0, -1.0], [-1.0, 1.0]]) / (SD_ASPECT * focal) ** 2
    return lens, information


def one_camera(
    size: tuple[int, int], focal: float, model: LensModel, known: tuple[Array, Array] | None = None
) -> CameraStates:
    """Return the start of one camera at the origin, with a free lens.

    Args:
        known: lens (12,) and information (12, 12) of an earlier calibration.
    """
    lens, information = known or lens_prior(size, focal, model)
    free = np.zeros((1, CAMERA), bool)
    free[0, POSE : POSE + LENS] = model.free
    return CameraStates(
        lens[None].copy(),
        np.array([model.fisheye]),
        np.eye(3)[None],
        np.zeros((1, 3)),
        np.zeros(1),
        free,
        lens[None].copy(),
        information[None],
        np.zeros(1),
    )


def zhang_focal(views: Sequence[TargetView], points: Array, size: tuple[int, int]) -> float | None:
    """Return the focal length, px, by Zhang's closed form; None where it has no plausible solution."""
    fit = [view for view in views if len(view.numbers) >= FEWEST_POINTS]
    if not fit:
        return None
    try:
        matrix = cv2.initCameraMatrix2D(
            [points[view.numbers].astype(np.float32) for view in fit],
            [view.pixels.astype(np.float32) for view in fit],
            size,
            1.0,
        )
    except cv2.error:
        return None
    focal = float(matrix[0, 0])
    low, high = PLAUSIBLE
    return focal if low * max(size) < focal < high * max(size) else None


def start_lens(
    views: Sequence[TargetView],
    points: Array,
    size: tuple[int, int],
    model: LensModel,
    known: tuple[Array, Array] | None = None,
) -> Array | None:
    """Return the lens (12,) of one camera from its own views; None if no view has a pose.

    Focal lengths from Zhang's form, or a blind row of them, start an adjustment each; the least cost counts.
    """
    chosen = [views[k] for k in np.unique(np.linspace(0, len(views) - 1, MOST_VIEWS).astype(int))]
    if known is not None:
        return known[0]
    zhang = None if model.fisheye else zhang_focal(chosen, points, size)
    best: tuple[float, Array] | None = None
    for focal in [zhang] if zhang else [share * max(size) for share in BLIND]:
        found = _adjusted_alone(chosen, points, one_camera(size, float(focal), model))
        if found and (best is None or found[0] < best[0]):
            best = found
    return None if best is None else best[1]


def _adjusted_alone(
    views: Sequence[TargetView], points: Array, camera: CameraStates
) -> tuple[float, Array] | None:
    """Return the cost per observation and the lens after two adjustments: few terms, then all."""
    intrinsics = intrinsics_of(camera.lenses[0], bool(camera.fisheye[0]))
    alone = [replace(view, camera=0) for view in views]
    poses = poses_of(alone, points, [intrinsics])
    usable = [k for k, found in enumerate(poses) if found]
    if not usable:
        return None
    renamed = [replace(alone[k], instant=n) for n, k in enumerate(usable)]
    seen = observations_of(renamed, points, np.array([NOISE_PX]))
    first = Targets(
        np.stack([poses[k][0].rotation for k in usable]), np.stack([poses[k][0].translation for k in usable])
    )
    free = camera.free
    few = free.copy()
    few[0, POSE + 2 : POSE + 4] = few[0, POSE + 5 :] = False
    state = Adjustment(replace(camera, free=few), first, np.zeros(len(seen.cameras)))
    state = adjust(seen, state, START_SCALE)
    state = adjust(seen, replace(state, cameras=replace(state.cameras, free=free)), START_SCALE)
    return state.cost / len(seen.pixels), state.cameras.lenses[0]
