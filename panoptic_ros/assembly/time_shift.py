"""Views with stamps of their own: how joints depend on motion, and the velocities by which views are moved.

A view of delay t sees a joint at X + t V. With rows A of the linearised observations, weights w and an
assumed velocity u, least squares gives to first order x = X + G (V - u), where
G = (sum w A^T A)^-1 sum w t A^T A. Minimised over the position, what is left of the cost says the velocity
with information W = sum w t^2 A^T A - (sum w t A^T A) G.

The innovation of a joint corrects its predicted velocity. Views are then moved a second time, by the
corrected velocity. Apart from that, positions remain functions of the images of this instant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain import Prediction, SkeletonModel, TimeShift
from panoptic_ros.geometry.robust import noise_growth
from panoptic_ros.kernels import njit
from panoptic_ros.solving.joint_records import Candidates, SolvedJoints
from panoptic_ros.solving.joints import solve_joints
from panoptic_ros.solving.scene import Scene, seen_at
from panoptic_ros.solving.triangulation import SolverRules

Array = np.ndarray

WEAKEST = 1e-6  # share of the largest information in the weakest direction of a joint, at least


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """What the views say of K people's J joints in motion.

    covariances: (K, J, 3, 3) m^2, of positions at the assumed velocity. delays (K, J, 3, 3) s,
    velocities (K, J, 3) m/s and information (K, J, 3, 3): see `TimeShift`.
    """

    covariances: Array
    delays: Array
    velocities: Array
    information: Array


def solved_in_motion(
    scene: Scene, found: Candidates, solved: SolvedJoints, prediction: Prediction, rules: SolverRules
) -> tuple[Candidates, SolvedJoints, Motion]:
    """The final solve again with better velocities, and how joints depend on motion.

    Returns the candidates with the velocities that were used.
    """
    motion = motion_of(scene, solved, found.guide.shifts, rules.cauchy)
    if (found.who >= 0).any():
        shifts = likelier_velocities(found, solved, motion, prediction)
        found = found._replace(guide=found.guide._replace(shifts=shifts))
        solved = solve_joints(found, scene.observations, rules)
        motion = motion_of(scene, solved, shifts, rules.cauchy)
    return found, solved, motion


def motion_of(scene: Scene, solved: SolvedJoints, shifts: Array, cauchy: float) -> Motion:
    """Delays of all joints, and what the views say of velocities besides those assumed, (K, J, 3) m/s."""
    normals, first, second, slopes = stamp_sums(solved, shifts, scene.observations, cauchy)
    scale = np.trace(normals, axis1=-2, axis2=-1)[..., None, None]
    covariances = np.linalg.inv(normals + (WEAKEST * scale + (scale <= 0.0)) * np.eye(3))
    delays = covariances @ first
    information = second - np.swapaxes(first, -1, -2) @ delays
    information = 0.5 * (information + np.swapaxes(information, -1, -2))
    strongest = np.trace(information, axis1=-2, axis2=-1)[..., None, None]
    floor = (WEAKEST * strongest + (strongest <= 0.0)) * np.eye(3)
    velocities = shifts + np.linalg.solve(information + floor, slopes[..., None])[..., 0]
    return Motion(covariances, delays, velocities, information)


def likelier_velocities(
    found: Candidates, solved: SolvedJoints, motion: Motion, prediction: Prediction
) -> Array:
    """Velocities (K, J, 3) m/s: the predicted ones after a Kalman update.

    The prediction is of constant velocity, the measurement is the position, of error G (V - u).
    """
    velocities = found.guide.shifts.copy()
    known = np.flatnonzero(found.who >= 0)
    people = found.who[known]
    variances = prediction.variances[people][..., None, None]  # (K, J, 3, 1, 1)
    pp, pv, vv = variances[..., 0, :, :], variances[..., 1, :, :], variances[..., 2, :, :]
    delays = motion.delays[known]
    turned, unit = np.swapaxes(delays, -1, -2), np.eye(3)
    spread = pp * unit + pv * (delays + turned) + vv * delays @ turned + motion.covariances[known]
    innovation = solved.positions[known] - prediction.positions[people]
    there = np.isfinite(innovation[..., 0])
    solution = np.linalg.solve(
        np.where(there[..., None, None], spread, unit), np.where(there[..., None], innovation, 0.0)[..., None]
    )
    velocities[known] += ((pv * unit + vv * turned) @ solution)[..., 0]
    return velocities


def time_shift(
    motion: Motion, kept: Array, positions: Array, shifts: Array, skeleton: SkeletonModel
) -> TimeShift:
    """The record for the people that were `kept` (P,), with joints at positions (P, J, 3).

    Derived joints have the mean of their parts.
    """
    arrays = [a[kept] for a in (motion.delays, shifts, motion.velocities, motion.information)]
    for joint, parts in skeleton.derived:
        for array in arrays:
            array[:, joint] = array[:, list(parts)].mean(axis=1)
        arrays[3][:, joint] = 0.0  # no view shows them
    for array in arrays:
        array[np.isnan(positions[..., 0])] = 0.0
    return TimeShift(*arrays)


@njit(cache=True, error_model="numpy")
def stamp_sums(solved, shifts, seen, cauchy):
    """Sums over the used views of w A^T A, w t A^T A, w t^2 A^T A (K, J, 3, 3), and w t A^T e (K, J, 3).

    Args:
        solved: `SolvedJoints`. shifts: (K, J, 3) m/s. seen: `Observations`. e is the observation minus the
            projection.
    """
    positions, _, residuals, picks = solved
    plane, precision = seen.plane, seen.precision
    rotations, delays = seen.cams.rotations, seen.cams.delays
    people, joints, views = residuals.shape
    normals = np.zeros((people, joints, 3, 3))
    first, second = np.zeros((people, joints, 3, 3)), np.zeros((people, joints, 3, 3))
    slopes = np.zeros((people, joints, 3))
    row, column = np.empty(3), np.empty(3)
    for p in range(people):
        for j in range(joints):
            if not np.isfinite(positions[p, j, 0]):
                continue
            for v in range(views):
                if residuals[p, j, v] < 0.0:
                    continue
                d, s = picks[p, j, v]
                t = delays[v]
                u, w, z = seen_at(seen.cams, v, positions[p, j], shifts[p, j])
                for k in range(3):
                    row[k] = (rotations[v, 0, k] - u * rotations[v, 2, k]) / z
                    column[k] = (rotations[v, 1, k] - w * rotations[v, 2, k]) / z
                weight = precision[d, s] ** 2 / noise_growth(residuals[p, j, v] ** 2, cauchy)
                du, dw = plane[d, s, 0] - u, plane[d, s, 1] - w
                for i in range(3):
                    slopes[p, j, i] += weight * t * (row[i] * du + column[i] * dw)
                    for k in range(3):
                        value = weight * (row[i] * row[k] + column[i] * column[k])
                        normals[p, j, i, k] += value
                        first[p, j, i, k] += t * value
                        second[p, j, i, k] += t * t * value
    return normals, first, second, slopes
