"""World frame of a calibration: z up and the floor at z = 0, as `cam_from_world` of each camera."""

from __future__ import annotations

import numpy as np

from panoptic_ros.calibration.projection import OFFSET, POSE
from panoptic_ros.calibration.solve import CalibratedRig
from panoptic_ros.calibration.target_poses import intrinsics_of
from panoptic_ros.domain import Camera, Rig
from panoptic_ros.geometry import Rigid

Array = np.ndarray
FIXED_POSE_SD = 1e-9  # rad and m, of the first camera, whose pose is the reference of the covariance


def floor_from_target(rig: CalibratedRig, target: int) -> Rigid:
    """Return the world from the first camera's frame, if a target lies on the floor.

    The origin is the target's origin, x is along its rows, z is the side of it that faces the cameras.
    """
    rotation, origin = rig.state.targets.rotations[target], rig.state.targets.translations[target]
    centres = -np.einsum("cji,cj->ci", rig.state.cameras.rotations, rig.state.cameras.translations)
    if (centres - origin).mean(axis=0) @ rotation[:, 2] < 0.0:
        rotation = rotation @ np.diag([1.0, -1.0, -1.0])
    return Rigid(rotation.T, -rotation.T @ origin)


def floor_from_images(rig: CalibratedRig) -> Rigid:
    """Return the world from the first camera's frame, if the images are upright on average.

    z is the mean direction that points up in the images. The origin is below the middle of the target's
    positions, at the height of its lowest point. x is the horizontal part of the first camera's view.
    """
    cameras, seen, targets = rig.state.cameras, rig.seen, rig.state.targets
    up = -cameras.rotations[:, 1, :].mean(axis=0)
    up = up / np.linalg.norm(up)
    block = seen.targets[seen.views]
    shown = np.einsum("mij,mj->mi", targets.rotations[block], seen.points) + targets.translations[block]
    middle = targets.translations.mean(axis=0)
    origin = middle + up * (np.min(shown @ up) - middle @ up)
    forward = cameras.rotations[0, 2] - up * (cameras.rotations[0, 2] @ up)
    forward = forward / np.linalg.norm(forward)
    rotation = np.stack([forward, np.cross(up, forward), up])
    return Rigid(rotation, -rotation @ origin)


def rig_in_world(rig: CalibratedRig, world_from_first: Rigid) -> Rig:
    """Return the rig in the world, with the covariance of each camera in its own frame.

    Covariances are relative to the first camera, whose pose is taken as exact.
    """
    first_from_world = world_from_first.inverse()
    states = rig.state.cameras
    cameras = []
    for c, given in enumerate(rig.inputs):
        pose = Rigid(_orthonormal(states.rotations[c]), states.translations[c]).compose(first_from_world)
        intrinsics = intrinsics_of(states.lenses[c], given.model.fisheye)
        size = POSE + 4 + len(intrinsics.distortion)
        rows = rig.index[c, :size]
        covariance = np.zeros((OFFSET, OFFSET))[:size, :size]
        free = np.flatnonzero(rows >= 0)
        covariance[np.ix_(free, free)] = rig.covariance[np.ix_(rows[free], rows[free])]
        fixed = np.flatnonzero(rows < 0)
        covariance[fixed, fixed] = FIXED_POSE_SD**2
        # t of the camera from the world is t_c + R_c t_first: a rotation of R_c moves the second part
        lever = states.rotations[c] @ first_from_world.translation
        change = np.eye(size)
        change[3:6, :3] = -_cross(lever)
        covariance = change @ covariance @ change.T
        cameras.append(
            Camera(given.name, given.size, intrinsics, pose, covariance=0.5 * (covariance + covariance.T))
        )
    return Rig(tuple(cameras))


def _cross(vector: Array) -> Array:
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _orthonormal(rotation: Array) -> Array:
    u, _, v = np.linalg.svd(rotation)
    turned: Array = u @ v
    return turned
