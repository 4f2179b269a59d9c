"""2D joints of different exposures: dependence of joints on motion, and corrected velocities.

A 2D joint with delay t shows a joint at X + t V. Let A be the rows of the linearised observations, w their
weights and u an assumed velocity. To first order, least squares gives

    x = X + G (V - u) with G = (sum w A^T A)^-1 sum w t A^T A.

After minimisation over the position, the remaining cost measures the velocity with the information

    W = sum w t^2 A^T A - (sum w t A^T A) G.

The innovation of a joint corrects its predicted velocity. Views are then moved to the instant a second time,
with the corrected velocity. Apart from that, positions depend on the images of this instant alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain import Prediction, SkeletonModel, TimeShift
from panoptic_ros.geometry.robust import noise_growth
from panoptic_ros.kernels import njit
from panoptic_ros.solving.joint_records import PersonCandidates, SolvedJoints
from panoptic_ros.solving.joints import solve_joints
from panoptic_ros.solving.scene import Scene, seen_at
from panoptic_ros.solving.triangulation import SolverRules

Array = np.ndarray

WEAKEST = 1e-6  # share of a joint's total information, added in each direction against singularity


@dataclass(frozen=True, slots=True, eq=False)
class MotionDependence:
    """Dependence of K people's J joints on motion, and the velocities that views measure.

    Args:
        covariances: (K, J, 3, 3) m^2, of the positions for the assumed velocity.
        delays: (K, J, 3, 3) s, see `TimeShift`.
        velocities: (K, J, 3) m/s, see `TimeShift`.
        information: (K, J, 3, 3) s^2/m^2, see `TimeShift`.
    """

    covariances: Array
    delays: Array
    velocities: Array
    information: Array


def solved_in_motion(
    scene: Scene, found: PersonCandidates, solved: SolvedJoints, prediction: Prediction, rules: SolverRules
) -> tuple[PersonCandidates, SolvedJoints, MotionDependence]:
    """Solve the joints again with corrected velocities, and compute their dependence on motion.

    New people have no prediction to correct. If all people are new, the solution stays unchanged.

    Returns:
        found: The candidates with the velocities that were used.
        solved: The solved joints.
        motion: Dependence on motion.
    """
    motion = motion_of(scene, solved, found.guide.shifts, rules.cauchy)
    if (found.who >= 0).any():
        shifts = likelier_velocities(found, solved, motion, prediction)
        found = found._replace(guide=found.guide._replace(shifts=shifts))
        solved = solve_joints(found, scene.observations, rules)
        motion = motion_of(scene, solved, shifts, rules.cauchy)
    return found, solved, motion


def motion_of(scene: Scene, solved: SolvedJoints, shifts: Array, cauchy: float) -> MotionDependence:
    """Return the delays of all joints, and the velocities that the views measure.

    Args:
        shifts: (K, J, 3) m/s, assumed velocities.
        cauchy: Scale of the Cauchy weight, in standard deviations.
    """
    normals, first, second, slopes = stamp_sums(solved, shifts, scene.observations, cauchy)
    scale = np.trace(normals, axis1=-2, axis2=-1)[..., None, None]
    covariances = np.linalg.inv(normals + (WEAKEST * scale + (scale <= 0.0)) * np.eye(3))
    delays = covariances @ first
    information = second - np.swapaxes(first, -1, -2) @ delays
    information = 0.5 * (information + np.swapaxes(information, -1, -2))
    strongest = np.trace(information, axis1=-2, axis2=-1)[..., None, None]
    floor = (WEAKEST * strongest + (strongest <= 0.0)) * np.eye(3)
    velocities = shifts + np.linalg.solve(information + floor, slopes[..., None])[..., 0]
    return MotionDependence(covariances, delays, velocities, information)


def likelier_velocities(
    found: PersonCandidates, solved: SolvedJoints, motion: MotionDependence, prediction: Prediction
) -> Array:
    """Return velocities (K, J, 3) m/s: the predicted ones after a Kalman update.

    The prediction has a constant velocity. The measurement is the position, with the error G (V - u).
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
    motion: MotionDependence, kept: Array, positions: Array, shifts: Array, skeleton: SkeletonModel
) -> TimeShift:
    """Return the record for the people that were kept (P,).

    Derived joints have the means of their parts, with an information of 0. Missing joints have zeros.

    Args:
        kept: (P,) rows of these people in `motion`.
        positions: (P, J, 3) m, world, their joints.
        shifts: (K, J, 3) m/s, assumed velocities.
    """
    arrays = [a[kept] for a in (motion.delays, shifts, motion.velocities, motion.information)]
    for joint, parts in skeleton.derived:
        for array in arrays:
            array[:, joint] = array[:, list(parts)].mean(axis=1)
        arrays[3][:, joint] = 0.0  # no view observes derived joints
    for array in arrays:
        array[np.isnan(positions[..., 0])] = 0.0
    return TimeShift(*arrays)


@njit(cache=True, error_model="numpy")
def stamp_sums(solved, shifts, seen, cauchy):
    """Return sums over the used views that determine delays and velocities.

    Args:
        solved: `SolvedJoints`.
        shifts: (K, J, 3) m/s, assumed velocities.
        seen: `SceneObservations`.
        cauchy: Scale of the Cauchy weight, in standard deviations.

    Returns:
        normals, first, second: (K, J, 3, 3), sums of w A^T A, w t A^T A and w t^2 A^T A.
        slopes: (K, J, 3), sum of w t A^T e. Here e is the observation minus the projection.
    """
    positions, _, residuals, picks = solved
    plane, precision = seen.plane, seen.precision
    rotations = seen.cams.rotations
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
                t = seen.delays[d, s]
                u, w, z = seen_at(seen.cams, v, positions[p, j], shifts[p, j], t)
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
