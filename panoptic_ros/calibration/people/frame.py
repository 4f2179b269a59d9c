"""Metres, up direction and floor of a calibration from the bodies of the people."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from panoptic_ros.calibration.people.solve import LIMB_JOINTS, CalibratedPeople
from panoptic_ros.calibration.projection import POSE
from panoptic_ros.calibration.tape import TAPE_SD_M, distance_of
from panoptic_ros.domain.bone_shares import ANKLE_SHARE, SHARES_SD, STATURE_M, STATURE_SD_M, log_scale
from panoptic_ros.geometry import Rigid

Array = np.ndarray
NECK, HIPS = 0, 1  # used joints
ANKLES = [2 + len(LIMB_JOINTS) * side + LIMB_JOINTS.index("Ankle") for side in range(2)]
LEG_BONES = [  # pairs of used joints: both thighs and shanks
    (2 + len(LIMB_JOINTS) * side + LIMB_JOINTS.index(a), 2 + len(LIMB_JOINTS) * side + LIMB_JOINTS.index(b))
    for side in range(2)
    for a, b in (("Hip", "Knee"), ("Knee", "Ankle"))
]
STANDING_M_S = 0.3  # m/s, speed of an ankle below which its foot stands on the floor
LOW_SHARE = 15.0  # percent of standing ankles below the start of the floor; joints may be wrong
NEAR_FLOOR_M = (0.08, 0.05, 0.03)  # m, distance of ankles from the plane that fit it, by round
ANKLE_SD_M = 0.02  # m, of a standing ankle, the same in about `REPEATED` instants
REPEATED = 10.0
HEIGHT_SD_M = 0.012  # m, of the heights of people's ankles, shoes included
STRAIGHT = 0.93  # distance of neck and ankles over the length of trunk and legs, of a standing person
LEAN_SD, SLOUCH_SD = 0.03, 0.2  # rad, of the mean axis of standing bodies, of the trunk of people who sit


class Bodies(NamedTuple):
    """Joints of P people at K instants: positions (P, K, J, 3) m and speeds (P, K, J) m/s, NaN = unknown."""

    positions: Array
    speeds: Array


class Scale(NamedTuple):
    """Scale of a reconstruction.

    Args:
        factor: Metres per unit. sd: Relative standard deviation.
        by_people: Factor that the bones give, with sd `by_people_sd`.
    """

    factor: float
    sd: float
    by_people: float
    by_people_sd: float


def bodies_of(found: CalibratedPeople) -> Bodies:
    """Return the joints of all people in the frame of the first camera."""
    joints, state = found.joints, found.rig.state
    shape = (int(joints.people.max()) + 1, len(found.instants), int(joints.joints.max()) + 1)
    positions, speeds = np.full((*shape, 3), np.nan), np.full(shape, np.nan)
    at = (joints.people, joints.instants, joints.joints)
    positions[at] = state.targets.translations
    speeds[at] = np.linalg.norm(joints.seen.twists[:, 3:], axis=1)
    return Bodies(positions, speeds)


def scale_of(
    found: CalibratedPeople, stature_m: float | None, distance: tuple[int, int, float] | None
) -> Scale:
    """Return the scale from bones, and a measured distance.

    Args:
        stature_m: m, mean stature of the people; None = that of adults.
        distance: Two cameras and their distance, m.
    """
    bodies = bodies_of(found)
    logs = np.array([log_scale(own, found.bones) for own in bodies.positions])
    weights = np.isfinite(bodies.positions[..., 0]).sum(axis=(1, 2)) * np.isfinite(logs)
    at_once = int(np.isfinite(bodies.positions[..., 0]).any(axis=2).sum(axis=0).max())
    factor = float(np.exp(np.average(np.nan_to_num(logs), weights=weights)))
    spread = SHARES_SD if stature_m else float(np.hypot(SHARES_SD, STATURE_SD_M / STATURE_M))
    by_people = factor * (stature_m or STATURE_M) / STATURE_M
    sd = spread / np.sqrt(max(at_once, 1))
    if distance is None:
        return Scale(by_people, sd, by_people, sd)
    first, second, metres = distance
    apart, _ = distance_of(found.rig, first, second)
    return Scale(metres / apart, TAPE_SD_M / metres, by_people, sd)


def scaled(found: CalibratedPeople, factor: float) -> CalibratedPeople:
    """Return the calibration with all lengths multiplied by `factor`, the covariance included."""
    rig, joints = found.rig, found.joints
    cameras, targets = rig.state.cameras, rig.state.targets
    gain = np.ones(len(rig.covariance))
    rows = rig.index[:, 3:POSE]
    gain[rows[rows >= 0]] = factor
    state = replace(
        rig.state,
        cameras=replace(cameras, translations=factor * cameras.translations),
        targets=replace(targets, translations=factor * targets.translations),
    )
    seen = rig.seen._replace(twists=rig.seen.twists * np.array([1.0] * 3 + [factor] * 3))
    covariance = rig.covariance * np.outer(gain, gain)
    return found._replace(
        rig=replace(rig, state=state, seen=seen, covariance=covariance), joints=joints._replace(seen=seen)
    )


def world_of(found: CalibratedPeople) -> Rigid:
    """Return the world from the first camera's frame: z up from the floor, the origin below the people.

    The first direction is the median from ankles to neck. Standing ankles then correct it, as far as they are
    spread over the floor.
    """
    bodies = bodies_of(found)
    up, height = _floor(bodies, *body_axis(bodies))
    middle = np.nanmedian(bodies.positions.reshape(-1, 3), axis=0)
    origin = middle - up * (middle @ up - height + ANKLE_SHARE * STATURE_M)
    ahead = found.rig.state.cameras.rotations[0, 2]
    forward = ahead - up * (ahead @ up)
    if np.linalg.norm(forward) < 0.1:  # the first camera looks along the vertical: its rows are level
        forward = found.rig.state.cameras.rotations[0, 0]
        forward = forward - up * (forward @ up)
    forward = forward / np.linalg.norm(forward)
    rotation = np.stack([forward, np.cross(up, forward), up])
    return Rigid(rotation, -rotation @ origin)


def body_axis(bodies: Bodies) -> tuple[Array, float]:
    """Return the unit median direction (3,) of bodies, and its standard deviation, rad.

    It is from ankles to neck of people with straight legs. Without such people it is from hips to neck.
    """
    neck, hips = bodies.positions[:, :, NECK], bodies.positions[:, :, HIPS]
    ankles = bodies.positions[:, :, ANKLES].mean(axis=2)
    legs = sum(
        np.linalg.norm(bodies.positions[:, :, a] - bodies.positions[:, :, b], axis=-1) for a, b in LEG_BONES
    )
    straight = np.linalg.norm(neck - hips, axis=-1) + 0.5 * legs
    standing = np.linalg.norm(neck - ankles, axis=-1) > STRAIGHT * straight
    for axes, sd in (((neck - ankles)[standing], LEAN_SD), (neck - hips, SLOUCH_SD)):
        axes = axes[np.isfinite(axes).all(axis=-1)]
        if len(axes):
            axis = np.median(axes / np.linalg.norm(axes, axis=1, keepdims=True), axis=0)
            return axis / np.linalg.norm(axis), sd
    return np.array([0.0, -1.0, 0.0]), 1.0


def _floor(bodies: Bodies, up: Array, lean_sd: float) -> tuple[Array, float]:
    """Return the up direction and the height of standing ankles along it.

    A plane is fitted to standing ankles. Each person has an own height of the ankle, with a spread. The given
    direction is the mean of a prior.
    """
    every = bodies.positions[:, :, ANKLES]
    standing = bodies.speeds[:, :, ANKLES] < STANDING_M_S
    standing = standing if standing.any() else np.isfinite(every).all(axis=-1)
    if not standing.any():
        return up, float(np.nanmin(bodies.positions.reshape(-1, 3) @ up))
    ankles, person = every[standing], np.nonzero(standing)[0]
    height = float(np.percentile(ankles @ up, LOW_SHARE))
    for near in NEAR_FLOOR_M:
        use = np.abs(ankles @ up - height) < near
        if not use.any():
            break
        own, middle = ankles[use], ankles[use].mean(axis=0)
        level = np.linalg.svd(up[None])[2][1:]
        people = np.eye(len(bodies.positions))[person[use]]
        rows = np.column_stack([(own - middle) @ level.T, np.ones(len(own)), people])
        prior = np.array([1.0 / lean_sd**2] * 2 + [0.0] + [1.0 / HEIGHT_SD_M**2] * people.shape[1])
        weight = 1.0 / (REPEATED * ANKLE_SD_M**2)
        found = np.linalg.solve(weight * rows.T @ rows + np.diag(prior), weight * rows.T @ (own @ up))
        up = up - found[:2] @ level
        up = up / np.linalg.norm(up)
        height = float(np.median(own @ up))
    return up, height
