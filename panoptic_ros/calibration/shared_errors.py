"""Errors that the points of a target share at an instant: a factor of the variances of the calibration."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from panoptic_ros.calibration.bundle import PLAIN, Adjustment, CameraStates, Observations
from panoptic_ros.calibration.normal_equations import linearise

Array = np.ndarray
MOST_VIEWS = 1000  # views that are enough for one number; the time grows with the cube of views of an instant
OPEN = 1e-9  # relative information about unknowns that a target leaves open: the roll of a straight wand


def shared_errors(seen: Observations, state: Adjustment, covariance: Array, index: Array) -> float:
    """Return the factor (at least 1) of the variances that accounts for errors shared by points of a target.

    A target that moves between images at different times is placed wrong for all of its points at once.
    Independent pixels understate the covariance then. The score of a target is its part of the gradient of
    the cameras. Scores scatter by their information if the errors are independent. The factor is their
    scatter over it (design effect, Moulton 1986; scores by cluster, Liang and Zeger 1986).

    Args:
        covariance: (N, N) of the free unknowns of the cameras. index: (C, CAMERA) their rows, -1 = fixed.
    """
    own, own_right, cross, target, target_right = _of_views(seen, state)
    scatter = expected = 0.0
    step = -(-len(seen.cameras) // MOST_VIEWS)
    for block in range(0, len(seen.firsts) - 1, step):
        views = slice(*seen.firsts[block : block + 2])
        rows = index[seen.cameras[views]].ravel()
        free, count = rows >= 0, len(seen.cameras[views])
        arms = cross[views].reshape(len(rows), -1)
        inverse = np.linalg.pinv(target[block], rcond=OPEN, hermitian=True)
        reduced = -arms @ inverse @ arms.T
        for v in range(count):
            part = slice(v * own.shape[1], (v + 1) * own.shape[1])
            reduced[part, part] += own[views][v]
        score = own_right[views].ravel() - arms @ (inverse @ target_right[block])
        reduced, score = reduced[np.ix_(free, free)], score[free]
        known = covariance[np.ix_(rows[free], rows[free])]
        weighted = known @ reduced
        scatter += score @ known @ score
        expected += np.trace(weighted) - np.sum(weighted * weighted.T)
    return max(1.0, float(scatter / expected)) if expected > 0.0 else 1.0


def _of_views(seen: Observations, state: Adjustment) -> tuple[Array, ...]:
    """Return the normal equations of `linearise` with the parts (V, ...) of cameras apart for each view."""
    cameras = state.cameras
    by_view: CameraStates = replace(
        cameras, **{field.name: getattr(cameras, field.name)[seen.cameras] for field in fields(cameras)}
    )
    found: tuple[Array, ...] = linearise(
        seen._replace(cameras=np.arange(len(seen.cameras))),
        by_view.lenses,
        by_view.fisheye,
        by_view.rotations,
        by_view.translations,
        by_view.offsets,
        state.targets.rotations,
        state.targets.translations,
        state.shifts,
        by_view.jitter,
        PLAIN,
    )
    return found[:5]
