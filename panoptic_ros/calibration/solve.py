"""Calibration of a rig from views of a target: rounds of adjustment and of noise, then the covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.calibration.bundle import (
    CONVERGED,
    PLAIN,
    Adjustment,
    CameraStates,
    Observations,
    Targets,
    adjust,
    covariance_of,
    residuals_of,
    shift_variances,
)
from panoptic_ros.calibration.normal_equations import moved, twists_of
from panoptic_ros.calibration.projection import OFFSET, POSE
from panoptic_ros.calibration.rig_start import SCALE, CameraInput, RigStart, start_rig, with_best_targets
from panoptic_ros.calibration.shared_errors import shared_errors
from panoptic_ros.calibration.target_views import TargetView, image_speeds, in_order, observations_of
from panoptic_ros.errors import CalibrationError
from panoptic_ros.geometry import Rigid

Array = np.ndarray
FIRST_NOISE_PX = 1.0  # px, noise of the pixels in the first round
FIRST_JITTER_S = 0.02  # s, time shifts of views in the first round with shifts; webcams show 5 to 50 ms
LEAST_JITTER_S = 1e-5  # s
LEAST_NOISE_PX = 0.01  # px
# Relative decrease of the cost that ends the steps of all rounds but the last. They determine the noise of
# cameras and outliers; the noise changes by half of it. Clocks follow from the differences of rounds.
ROUGH = 1e-3
MOST_ROUNDS, SETTLED = 12, 0.01  # rounds of noise and adjustment; relative change of the noise that ends them
OUTLIER = 4.0  # standard deviations per axis; a Gaussian has 6e-5 beyond
MEDIAN_SQUARE = 2.0 * np.log(2.0)  # median of a chi-squared variable with two degrees of freedom
# px, noise of a camera beyond which its views contradict those of others. Mirrored images and second boards
# give 3 to 130 px, webcams with random delays up to 2 px.
CONTRADICTION_PX = 2.5
CHECK = "its driver does not mirror images, that only one board is shown, that stamps are right, and --board"
SEPARATE = 0.7  # share of free residuals from which each camera has a noise of its own
MOVING_PX_S = 2.0  # px/s, median speed of a camera's points below which its clock is not estimated


@dataclass(frozen=True, eq=False)
class CalibratedRig:
    """Result of a calibration.

    Args:
        inputs: Cameras, as given.
        views: Views that were used, sorted by instant, then camera, as those of `seen`.
        seen: Observations without outliers.
        state: All unknowns, in the frame of the first camera.
        covariance: (N, N) of the free unknowns of the cameras. index: (C, CAMERA) their rows, -1 = fixed.
        noise: (C,) px, standard deviation of the pixels per axis.
        links: Instants that link each pair of cameras.
        outliers: (C,) number of points that were left out.
    """

    inputs: tuple[CameraInput, ...]
    views: tuple[TargetView, ...]
    seen: Observations
    state: Adjustment
    covariance: Array
    index: Array
    noise: Array
    links: dict[tuple[int, int], int]
    outliers: Array

    @property
    def rejected(self) -> Array:
        """Return whether most points of a view (V,) were left out; free points have no views."""
        if not self.views:
            return np.zeros(len(self.seen.cameras), bool)
        found = np.array([len(view.numbers) for view in self.views])
        return 2 * np.diff(self.seen.starts) < found

    def sd(self, camera: int, unknowns: slice) -> Array:
        """Return the standard deviations of unknowns of a camera; 0 where they are fixed."""
        rows = self.index[camera, unknowns]
        variances = np.diag(self.covariance)[np.maximum(rows, 0)]
        return np.where(rows >= 0, np.sqrt(np.maximum(variances, 0.0)), 0.0)


def calibrate_rig(
    cameras: Sequence[CameraInput],
    views: Sequence[TargetView],
    points: Array,
    clocks: bool = True,
    turns: Sequence[Rigid] = (),
) -> CalibratedRig:
    """Return the calibration of cameras from views of a target with known points.

    Args:
        views: Views of all cameras; instants are any integers.
        points: (N, 3) m, points of the target.
        clocks: Estimate a clock offset per camera and a time shift per view from the image velocity.
        turns: Motions after which the target looks the same, see `Board.turns`.

    Raises:
        CalibrationError: if the views do not determine the calibration.
    """
    return calibrate_from(start_rig(cameras, views, points, turns), cameras, points, clocks)


def calibrate_from(
    start: RigStart, cameras: Sequence[CameraInput], points: Array, clocks: bool
) -> CalibratedRig:
    """Return the calibration of cameras from a start, see `calibrate_rig`.

    Raises:
        CalibrationError: if the views do not determine the calibration.
    """
    try:
        return _calibrated(start, cameras, points, clocks)
    except np.linalg.LinAlgError:
        raise CalibrationError(
            "the views of the board do not determine the cameras; show it in more places and tilts"
        ) from None


def _calibrated(
    start: RigStart, cameras: Sequence[CameraInput], points: Array, clocks: bool
) -> CalibratedRig:
    """Return the calibration, see `calibrate_rig`.

    Raises:
        LinAlgError: if an unknown is not observable.
    """
    noise = np.full(len(cameras), FIRST_NOISE_PX)
    seen = observations_of(start.views, points, noise)
    state = _settled(seen, start)
    ordered = [start.views[k] for k in in_order(start.views)]
    if clocks:
        state = replace(state, cameras=_with_clocks(seen, _speeds(ordered, seen, state), state.cameras))
    for _ in range(MOST_ROUNDS):
        before, noise = noise, robust_noise(seen, state, len(cameras))
        seen = seen._replace(variances=(noise**2)[seen.cameras[seen.views]])
        if clocks:
            seen = seen._replace(twists=_twists(seen, _speeds(ordered, seen, state), state))
        state = adjust(seen, state, SCALE, converged=CONVERGED if clocks else ROUGH)
        try:
            if clocks:
                seen, state = _recentred(seen, _with_jitter(seen, state))
        except np.linalg.LinAlgError:
            break
        if (np.abs(noise / before - 1.0) < SETTLED).all():
            break
    refuse_contradictions(cameras, robust_noise(seen, state, len(cameras)), "views of the board", CHECK)
    good = ((residuals_of(seen, state) ** 2) / seen.variances[:, None] < OUTLIER**2).all(axis=1)
    outliers = np.bincount(seen.cameras[seen.views][~good], minlength=len(cameras))
    seen = _kept(seen, good)
    state = adjust(seen, state, PLAIN, converged=ROUGH)
    noise = plain_noise(seen, state, len(cameras))
    seen = seen._replace(variances=(noise**2)[seen.cameras[seen.views]])
    state = adjust(seen, state, PLAIN)
    covariance, index = covariance_of(seen, state)
    if clocks:  # between images at different times, targets move
        covariance *= shared_errors(seen, state, covariance, index)
    return CalibratedRig(
        tuple(cameras), tuple(ordered), seen, state, covariance, index, noise, start.links, outliers
    )


def refuse_contradictions(cameras: Sequence[CameraInput], noise: Array, seen: str, check: str) -> None:
    """Refuse cameras whose pixels do not fit to those of the others, given the noise (C,) px of all cameras.

    Args:
        seen: Name of the pixels, for the message. check: Advice, for the message.

    Raises:
        CalibrationError: naming these cameras.
    """
    names = [f"{own.name} ({px:.0f} px)" for own, px in zip(cameras, noise) if px > CONTRADICTION_PX]
    if names:
        raise CalibrationError(
            f"camera{'s' * (len(names) > 1)} {', '.join(names)}: {seen} contradict those of other cameras; "
            f"check that {check}"
        )


def _settled(seen: Observations, start: RigStart) -> Adjustment:
    """Return the first adjustment, after targets with mirrored poses are corrected."""
    state = adjust(seen, start.state, SCALE, converged=ROUGH)
    again = with_best_targets(seen, state, start.candidates)
    if np.array_equal(again.targets.rotations, state.targets.rotations):
        return state
    return adjust(seen, again, SCALE, converged=ROUGH)


def _with_clocks(seen: Observations, speeds: Array, cameras: CameraStates) -> CameraStates:
    """Return cameras with free clock offsets, but for the first, and with time shifts of views.

    Cameras in which the target does not move keep their clock: nothing determines it.
    """
    speed = np.linalg.norm(speeds, axis=1)
    own = seen.cameras[seen.views]
    moving = np.array([np.median(speed[own == c]) > MOVING_PX_S for c in range(len(cameras))])
    free = cameras.free.copy()
    free[1:, OFFSET] = moving[1:]
    return replace(cameras, free=free, jitter=np.where(moving, FIRST_JITTER_S, 0.0))


def _lags(seen: Observations, state: Adjustment) -> Array:
    """Return the time (V,) s of each view after the instant of its target."""
    lags: Array = seen.delays + state.cameras.offsets[seen.cameras] + state.shifts
    return lags


def _speeds(ordered: Sequence[TargetView], seen: Observations, state: Adjustment) -> Array:
    """Return the image velocities (M, 2) px/s at the estimated times of the views, which are in order."""
    late = state.cameras.offsets[seen.cameras] + state.shifts
    return np.concatenate(image_speeds(ordered, np.array([view.stamp_s for view in ordered]) + late))


def _recentred(seen: Observations, state: Adjustment) -> tuple[Observations, Adjustment]:
    """Return the same state with the instant of each target at the mean time of its views.

    Targets move along straight lines and at constant rates between their views, which holds for short times.
    """
    lags = _lags(seen, state)
    count = np.bincount(seen.targets)
    means = np.bincount(seen.targets, weights=lags) / count
    turns, moves = moved(state.targets.rotations, state.targets.translations, seen.twists * means[:, None])
    seen = seen._replace(delays=seen.delays - means[seen.targets])
    return seen, replace(state, targets=Targets(turns, moves))


def _twists(seen: Observations, speeds: Array, state: Adjustment) -> Array:
    """Return the motion (B, 6) of each target, see `Observations`."""
    cameras = state.cameras
    twists: Array = twists_of(
        seen,
        speeds,
        cameras.lenses,
        cameras.fisheye,
        cameras.rotations,
        cameras.translations,
        state.targets.rotations,
        state.targets.translations,
    )
    return twists


def _with_jitter(seen: Observations, state: Adjustment) -> Adjustment:
    """Return the state with the standard deviation of the shifts of each camera, by MacKay's rule.

    Views that say nothing about their shift, such as single views of an instant, do not count.
    """
    cameras, own = state.cameras, seen.cameras
    known = 1.0 - shift_variances(seen, state, SCALE) / np.maximum(cameras.jitter, LEAST_JITTER_S)[own] ** 2
    count = np.bincount(own, weights=np.maximum(known, 0.0), minlength=len(cameras))
    squares = np.bincount(own, weights=state.shifts**2, minlength=len(cameras))
    found = np.sqrt(squares / np.maximum(count, 1.0))
    found = np.where(cameras.jitter > 0.0, np.maximum(found, LEAST_JITTER_S), 0.0)
    return replace(state, cameras=replace(cameras, jitter=found))


def _freedom(seen: Observations, state: Adjustment) -> float:
    """Return the share of the residuals that the unknowns do not explain."""
    known = 2 * len(seen.pixels)
    own = POSE if seen.points.any() else POSE // 2  # a free point has a position only
    unknown = int(state.cameras.free.sum()) + own * (len(seen.firsts) - 1)
    return max(1.0 - unknown / known, 0.1)


def robust_noise(seen: Observations, state: Adjustment, cameras: int) -> Array:
    """Return the noise (C,) px per axis from the median of the squared residuals of each camera."""
    medians = np.array([np.median(own) for own in _squares(seen, state, cameras)])
    noise: Array = np.maximum(np.sqrt(medians / (MEDIAN_SQUARE * _freedom(seen, state))), LEAST_NOISE_PX)
    return noise


def plain_noise(seen: Observations, state: Adjustment, cameras: int) -> Array:
    """Return the noise (C,) px per axis from the mean of the squared residuals of each camera."""
    means = np.array([own.mean() for own in _squares(seen, state, cameras)])
    noise: Array = np.maximum(np.sqrt(0.5 * means / _freedom(seen, state)), LEAST_NOISE_PX)
    return noise


def _squares(seen: Observations, state: Adjustment, cameras: int) -> list[Array]:
    """Return the squared residuals, px^2, of each camera, or those of all cameras for each of them.

    Targets of few points follow the camera with the least noise, whose residuals would then vanish.
    """
    squares, own = (residuals_of(seen, state) ** 2).sum(axis=1), seen.cameras[seen.views]
    if _freedom(seen, state) < SEPARATE:
        return [squares] * cameras
    return [squares[own == c] for c in range(cameras)]


def _kept(seen: Observations, good: Array) -> Observations:
    """Return the observations without outliers; a view may be left without points."""
    sizes = np.add.reduceat(good.astype(np.int64), seen.starts[:-1])
    return seen._replace(
        starts=np.concatenate([[0], np.cumsum(sizes)]),
        numbers=seen.numbers[good],
        points=seen.points[good],
        pixels=seen.pixels[good],
        variances=seen.variances[good],
    )
