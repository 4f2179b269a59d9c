"""Calibration of cameras with known lenses from a pattern: start, adjustment, outliers, covariance, scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from panoptic_ros.calibration.bundle import (
    PLAIN,
    Adjustment,
    CameraStates,
    Observations,
    Targets,
    adjust,
    covariance_of,
    residuals_of,
)
from panoptic_ros.calibration.free_points import kept_points
from panoptic_ros.calibration.pattern.start import (
    FEWEST,
    pattern_table,
    placed_cameras,
    started,
    triangulated_points,
)
from panoptic_ros.calibration.pattern.tracks import PatternSightings, thinned
from panoptic_ros.calibration.projection import POSE
from panoptic_ros.calibration.rig_start import SCALE, CameraInput, free_cameras
from panoptic_ros.calibration.solve import (
    OUTLIER,
    CalibratedRig,
    plain_noise,
    refuse_contradictions,
    robust_noise,
)
from panoptic_ros.calibration.tape import TAPE_SD_M
from panoptic_ros.errors import CalibrationError
from panoptic_ros.geometry import ProjectionStack, Rigid
from panoptic_ros.stage import Progress

Array = np.ndarray
CHECK = "its intrinsics are those of this lens and image size, and that its images show the same scenes"
GIVEN_PX = 10.0  # px, first noise with given poses: 0.5 degrees and 2 cm are 5 to 12 px
STEPS = 12  # most steps of an adjustment
# Relative decreases of the cost that end adjustments: before the noise is known, and at the end. A step
# takes 10 to 20 s with 480 cameras. The scale is fixed, so no slow direction is left.
NEAR, CONVERGED = 0.02, 2e-5


def calibrate_pattern(
    cameras: Sequence[CameraInput],
    sightings: PatternSightings,
    tape: tuple[int, int, float],
    progress: Progress,
    poses: Sequence[Rigid] | None = None,
) -> CalibratedRig:
    """Return the calibration of cameras from the points of a pattern.

    Args:
        cameras: Cameras with known lenses.
        tape: Two cameras and their measured distance, m.
        poses: Approximate poses, camera from world; None = unknown.

    Raises:
        CalibrationError: if a lens is unknown, or a camera shares too few points with the others.
    """
    states = _states(cameras)
    sightings = thinned(sightings)
    _refuse_few(cameras, sightings)
    progress(0.0, "start")
    table = pattern_table(sightings.table(len(cameras)), states)
    if poses is None:
        placed = placed_cameras(table, states)
        if missing := [own.name for own, pose in zip(cameras, placed) if pose is None]:
            raise CalibrationError(_unlinked(cameras, missing))
        poses = [pose for pose in placed if pose is not None]
    stack = ProjectionStack(
        np.stack([pose.rotation for pose in poses]),
        np.stack([pose.translation for pose in poses]),
        states.lenses[:, :2].mean(axis=1),
    )
    points = triangulated_points(stack, table.plane, GIVEN_PX)
    seen, state, _ = started(table, states, poses, points, GIVEN_PX)
    del table, points
    try:
        rig = _adjusted(cameras, seen, state, progress)
    except np.linalg.LinAlgError:
        raise CalibrationError(
            "the pattern does not determine the cameras; show it in more places, and nearer to each camera"
        ) from None
    return with_distance(rig, *tape)


def _states(cameras: Sequence[CameraInput]) -> CameraStates:
    """Return the cameras at the origin with free lenses and poses, but for the pose of the first.

    Raises:
        CalibrationError: naming cameras without a known lens.
    """
    if blind := [camera.name for camera in cameras if camera.known is None]:
        raise CalibrationError(
            f"a pattern needs known lenses: camera{'s' * (len(blind) > 1)} {', '.join(blind)}; give "
            "--intrinsics, e.g. from a board before each camera"
        )
    return free_cameras(cameras, [camera.known[0] for camera in cameras if camera.known is not None])


def _refuse_few(cameras: Sequence[CameraInput], sightings: PatternSightings) -> None:
    """Refuse cameras with too few common points.

    Raises:
        CalibrationError: naming these cameras.
    """
    counts = np.bincount(sightings.cameras, minlength=len(cameras))
    if few := [f"{camera.name} ({n})" for camera, n in zip(cameras, counts) if n < FEWEST]:
        more = len(few) > 1
        raise CalibrationError(
            f"camera{'s' * more} {', '.join(few)}: too few points in common with other cameras, at least "
            f"{FEWEST} are needed; show more of the pattern, or leave the camera{'s' * more} out"
        )


def _unlinked(cameras: Sequence[CameraInput], missing: Sequence[str]) -> str:
    more = len(missing) > 1
    return (
        f"camera{'s' * more} {', '.join(missing)}: too few points in common with {cameras[0].name} or a "
        f"camera linked to it, at least {FEWEST} are needed; show the pattern where both see it, or "
        f"leave the camera{'s' * more} out"
    )


def _adjusted(
    cameras: Sequence[CameraInput], seen: Observations, state: Adjustment, progress: Progress
) -> CalibratedRig:
    """Return the calibration with an arbitrary scale, see `calibrate_pattern`.

    Raises:
        LinAlgError: if an unknown is not observable.
    """
    count = len(cameras)
    for title in ("adjustment", "noise"):
        progress(0.1 if title == "adjustment" else 0.4, title)
        state = adjust(seen, state, SCALE, STEPS, NEAR)
        noise = robust_noise(seen, state, count)
        seen = seen._replace(variances=(noise**2)[seen.cameras])
    progress(0.6, "outliers")
    refuse_contradictions(cameras, noise, "points of the pattern", CHECK)
    squares = residuals_of(seen, state) ** 2
    good: Array = np.all(squares < OUTLIER**2 * seen.variances[:, None], axis=1)
    before = np.bincount(seen.cameras, minlength=count)
    seen, state, _, _ = kept_points(seen, state, good)
    outliers = before - np.bincount(seen.cameras, minlength=count)
    state = adjust(seen, state, PLAIN, STEPS, CONVERGED)
    noise = plain_noise(seen, state, count)
    seen = seen._replace(variances=(noise**2)[seen.cameras])
    progress(0.8, "covariance")
    covariance, index = covariance_of(seen, state)
    links = _links(seen, count)
    return CalibratedRig(tuple(cameras), (), seen, state, covariance, index, noise, links, outliers)


def _links(seen: Observations, count: int) -> dict[tuple[int, int], int]:
    """Return the number of common points of each pair of cameras that has some."""
    table = np.zeros((len(seen.firsts) - 1, count), np.float32)
    table[seen.targets, seen.cameras] = 1.0
    common = np.triu(table.T @ table, 1)
    return {(int(a), int(b)): int(common[a, b]) for a, b in zip(*np.nonzero(common))}


def with_distance(rig: CalibratedRig, first: int, second: int, metres: float) -> CalibratedRig:
    """Return the calibration with the measured distance of two cameras, and the covariance that follows.

    The adjustment fixed one coordinate of a translation, which becomes free. A step of the other unknowns
    changes the distance. A change of the scale restores it. The tape's error adds another change of scale.

    Args:
        metres: Distance of the optical centres, m, measured with a standard deviation of `TAPE_SD_M`.
    """
    states = rig.state.cameras
    turns, moves = states.rotations, states.translations
    apart = turns[first].T @ moves[first] - turns[second].T @ moves[second]  # second centre minus first
    length = float(np.linalg.norm(apart))
    slope = np.zeros(len(rig.covariance))  # derivative of the logarithm of the distance
    for camera, sign in ((first, -1.0), (second, 1.0)):
        along = -sign * turns[camera] @ apart / length**2  # by the translation
        by_pose = np.concatenate([np.cross(along, moves[camera]), along])
        rows = rig.index[camera, :POSE]
        slope[rows[rows >= 0]] += by_pose[rows >= 0]
    free = rig.index >= 0
    free[1:, :POSE] = True
    index = np.full(free.shape, -1)
    index[free] = np.arange(int(free.sum()))
    old = np.flatnonzero(rig.index[free] >= 0)
    scale = np.zeros(int(free.sum()))  # derivative of the unknowns by the logarithm of the scale
    rows = index[:, 3:POSE]
    scale[rows[rows >= 0]] = moves[rows >= 0]
    covariance = np.zeros((len(scale), len(scale)))
    covariance[np.ix_(old, old)] = rig.covariance
    pull = np.zeros(len(scale))
    pull[old] = rig.covariance @ slope
    spread = float(slope @ rig.covariance @ slope) + (TAPE_SD_M / metres) ** 2
    half = 0.5 * spread * scale - pull
    for row in range(len(scale)):  # row by row, because the matrix of 480 cameras takes 400 MB
        covariance[row] += scale[row] * half + half[row] * scale
    factor = metres / length
    gain = np.ones(len(scale))
    gain[rows[rows >= 0]] = factor
    covariance *= gain[:, None]
    covariance *= gain
    targets = Targets(rig.state.targets.rotations, factor * rig.state.targets.translations)
    state = replace(
        rig.state, cameras=replace(states, translations=factor * moves, free=free), targets=targets
    )
    return replace(rig, state=state, covariance=covariance, index=index)
