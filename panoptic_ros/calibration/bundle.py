"""Bundle adjustment of cameras and targets: Gauss-Newton steps with damping (Levenberg and Marquardt)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.linalg.lapack import dpotri

from panoptic_ros.calibration.normal_equations import cost_of, linearise, moved, reduce_to_cameras, residuals
from panoptic_ros.calibration.projection import CAMERA, OFFSET, POSE

Array = np.ndarray
DAMPING = 1e-4  # first relative damping of the diagonal
GREATEST_DAMPING = 1e10  # relative; no step reduces the cost beyond it
RISE, FALL = 10.0, 0.1  # factors of the damping after a refused and an accepted step
CONVERGED = 2e-6  # relative decrease of the cost below which the steps end
LEAST = 1e-12  # px^-2, information below which an unknown of a target is fixed
ROLL = 1e-9  # relative information about unknowns that a target leaves open: the roll of a straight wand
PLAIN = 1e6  # scale of the Cauchy weight, in standard deviations, at which all weights are 1


class Observations(NamedTuple):
    """Pixels of the points of targets, sorted by target, then camera.

    Args:
        cameras, targets: (V,) of each view.
        starts: (V + 1,) first observation of each view.
        firsts: (B + 1,) first view of each target.
        numbers: (M,) point of the target.
        points: (M, 3) m, in the frame of the target.
        pixels: (M, 2) px.
        variances: (M,) px^2 per axis.
        delays: (V,) s, stamp of each view minus the time of the target's instant.
        twists: (B, 6) rad/s and m/s, motion of each target; 0 = still or unknown.
    """

    cameras: Array
    targets: Array
    starts: Array
    firsts: Array
    numbers: Array
    points: Array
    pixels: Array
    variances: Array
    delays: Array
    twists: Array

    @property
    def views(self) -> Array:
        """Return the view (M,) of each observation."""
        return np.repeat(np.arange(len(self.cameras)), np.diff(self.starts))


@dataclass(frozen=True, eq=False)
class CameraStates:
    """Unknowns of C cameras, and what is known of them beforehand.

    Args:
        lenses: (C, 12) fx, fy, cx, cy (px) and terms of distortion, see `projection.project`.
        fisheye: (C,) bool.
        rotations, translations: (C, 3, 3), (C, 3) m, camera from world.
        offsets: (C,) s; the master clock is the stamp plus the offset.
        free: (C, CAMERA) bool, unknowns that are estimated.
        prior: (C, LENS) px or without unit, expected lens.
        prior_information: (C, LENS, LENS), inverse covariance of the prior.
        jitter: (C,) s, standard deviation of the time shift of each view; 0 = none.
    """

    lenses: Array
    fisheye: Array
    rotations: Array
    translations: Array
    offsets: Array
    free: Array
    prior: Array
    prior_information: Array
    jitter: Array

    def __len__(self) -> int:
        return len(self.lenses)

    def only(self, camera: int) -> CameraStates:
        """Return the unknowns of one camera."""
        return CameraStates(*(getattr(self, name)[camera : camera + 1] for name in self.__annotations__))


@dataclass(frozen=True, eq=False)
class Targets:
    """Poses of B targets, world from target: rotations (B, 3, 3), translations (B, 3) m."""

    rotations: Array
    translations: Array


@dataclass(frozen=True, eq=False)
class Adjustment:
    """State of the adjustment.

    Args:
        shifts: (V,) s, time shift of each view.
        cost: Sum of the losses, of the priors and of the shifts.
        steps: Number of accepted steps.
        damping: Relative damping of the next step. Rounds continue with that of the round before.
    """

    cameras: CameraStates
    targets: Targets
    shifts: Array
    cost: float = float("inf")
    steps: int = 0
    damping: float = DAMPING


def residuals_of(seen: Observations, state: Adjustment) -> Array:
    """Return the residuals (M, 2) px of all observations."""
    cameras, targets = state.cameras, state.targets
    found: Array = residuals(
        seen,
        cameras.lenses,
        cameras.fisheye,
        cameras.rotations,
        cameras.translations,
        cameras.offsets,
        targets.rotations,
        targets.translations,
        state.shifts,
    )
    return found


def total_cost(seen: Observations, state: Adjustment, scale: float) -> float:
    """Return the cost of a state: losses of residuals, priors of lenses, priors of shifts."""
    cameras = state.cameras
    miss = cameras.lenses - cameras.prior
    prior = np.einsum("ci,cij,cj->", miss, cameras.prior_information, miss)
    jitter = cameras.jitter[seen.cameras]
    late = (state.shifts / np.where(jitter > 0.0, jitter, np.inf)) ** 2
    return float(cost_of(residuals_of(seen, state), seen.variances, scale) + prior + late.sum())


class _System(NamedTuple):
    """Normal equations of the cameras, and what the targets and shifts need afterwards."""

    reduced: Array
    right: Array
    rows: Array
    cross: Array
    target: Array
    target_right: Array
    inverse: Array
    shift: Array


def _system(seen: Observations, state: Adjustment, scale: float, damping: float) -> _System:
    """Return the normal equations (N, N) of the free unknowns of the cameras."""
    cameras = state.cameras
    own, own_right, cross, target, target_right, shift = linearise(
        seen,
        cameras.lenses,
        cameras.fisheye,
        cameras.rotations,
        cameras.translations,
        cameras.offsets,
        state.targets.rotations,
        state.targets.translations,
        state.shifts,
        cameras.jitter,
        scale,
    )
    own[:, POSE:OFFSET, POSE:OFFSET] += cameras.prior_information
    own_right[:, POSE:OFFSET] += np.einsum(
        "cij,cj->ci", cameras.prior_information, cameras.prior - cameras.lenses
    )
    index = np.full((len(cameras), CAMERA), -1)
    index[cameras.free] = np.arange(int(cameras.free.sum()))
    diagonal = np.einsum("bii->bi", target)
    fixed = diagonal < LEAST
    diagonal[:] = np.where(fixed, 1.0, diagonal * (1.0 + damping + ROLL))
    inverse = np.linalg.inv(target)
    inverse[np.broadcast_to(fixed[:, :, None] | fixed[:, None, :], inverse.shape)] = 0.0
    size = int(index.max()) + 1
    reduced, right = np.zeros((size, size)), np.zeros(size)
    for camera in range(len(cameras)):
        rows = index[camera][cameras.free[camera]]
        free = cameras.free[camera]
        block = own[camera][np.ix_(free, free)]
        np.einsum("ii->i", block)[:] *= 1.0 + damping
        reduced[np.ix_(rows, rows)] = block
        right[rows] = own_right[camera][free]
    reduce_to_cameras(seen.cameras, seen.firsts, index, inverse, cross, target_right, reduced, right)
    return _System(reduced, right, index, cross, target, target_right, inverse, shift)


def _factor(reduced: Array) -> tuple[Array, tuple[Array, bool]]:
    """Return scales (N,) and the Cholesky factor of the scaled matrix (N, N), which is overwritten.

    Raises:
        LinAlgError: if the matrix is not positive definite.
    """
    scale: Array = 1.0 / np.sqrt(np.maximum(np.diag(reduced), LEAST))
    reduced *= scale[:, None]
    reduced *= scale
    return scale, cho_factor(reduced.T, lower=False, overwrite_a=True)


def _stepped(seen: Observations, state: Adjustment, system: _System) -> Adjustment:
    """Return the state after one step.

    Raises:
        LinAlgError: if the normal equations are singular.
    """
    cameras = state.cameras
    scale, factor = _factor(system.reduced)
    free = scale * cho_solve(factor, scale * system.right)
    step = np.zeros((len(cameras), CAMERA))
    step[cameras.free] = free
    pulled = system.target_right.copy()
    np.subtract.at(pulled, seen.targets, np.einsum("vpk,vp->vk", system.cross, step[seen.cameras]))
    target_step = np.einsum("bij,bj->bi", system.inverse, pulled)
    rotations, translations = moved(cameras.rotations, cameras.translations, step[:, :POSE])
    turns, moves = moved(state.targets.rotations, state.targets.translations, target_step)
    weight, own = system.shift[:, -2], system.shift[:, -1]
    along = np.concatenate([step[seen.cameras], target_step[seen.targets]], axis=1)
    pull = own - np.einsum("vp,vp->v", system.shift[:, :-2], along)
    change = np.where(weight > 0.0, pull / np.where(weight > 0.0, weight, 1.0), 0.0)
    return Adjustment(
        replace(
            cameras,
            lenses=cameras.lenses + step[:, POSE:OFFSET],
            offsets=cameras.offsets + step[:, OFFSET],
            rotations=rotations,
            translations=translations,
        ),
        Targets(turns, moves),
        state.shifts + change,
    )


def adjust(
    seen: Observations, state: Adjustment, scale: float, most: int = 50, converged: float = CONVERGED
) -> Adjustment:
    """Return the state of least cost.

    Args:
        scale: scale of the Cauchy weights, in standard deviations.
        most: greatest number of steps, refused ones included.
        converged: relative decrease of the cost below which the steps end.
    """
    state = replace(state, cost=total_cost(seen, state, scale))
    damping = state.damping
    for _ in range(most):
        try:
            found = _stepped(seen, state, _system(seen, state, scale, damping))
            cost = total_cost(seen, found, scale)
        except (LinAlgError, np.linalg.LinAlgError):
            cost = float("inf")
        done = abs(state.cost - cost) < converged * state.cost
        if cost < state.cost:
            damping = max(damping * FALL, 1e-12)
            state = replace(found, cost=cost, steps=state.steps + 1, damping=damping)
        else:
            damping *= RISE
        if done or damping > GREATEST_DAMPING:
            break
    return state


def shift_variances(seen: Observations, state: Adjustment, scale: float) -> Array:
    """Return the variances (V,) s^2 of the time shifts, given the cameras; targets are marginalised."""
    system = _system(seen, state, scale, 0.0)
    weight = np.maximum(system.shift[:, -2], 1e-300)
    pull = system.shift[:, CAMERA : CAMERA + POSE]
    pose = np.einsum("vi,vij,vj->v", pull, system.inverse[seen.targets], pull)
    variances: Array = 1.0 / weight + pose / weight / weight
    return variances


def covariance_of(seen: Observations, state: Adjustment) -> tuple[Array, Array]:
    """Return the covariance (N, N) of the cameras, and the row of each unknown (C, CAMERA), -1 = fixed.

    Weights are 1: remove outliers beforehand.

    Raises:
        LinAlgError: if an unknown is not observable.
    """
    system = _system(seen, state, PLAIN, 0.0)
    scale, factor = _factor(system.reduced)
    covariance, failed = dpotri(factor[0], lower=0, overwrite_c=1)  # in place: 480 cameras have 7200 unknowns
    if failed:
        raise LinAlgError(f"unknown {failed} is not observable")
    for row in range(1, len(scale)):
        covariance[row, :row] = covariance[:row, row]
    covariance *= scale[:, None]
    covariance *= scale
    return covariance, system.rows
