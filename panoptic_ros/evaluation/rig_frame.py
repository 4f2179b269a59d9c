"""World frame of a rig: floor from marked points, and changes of frame and scale."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.errors import CalibrationError
from panoptic_ros.geometry import Rigid, triangulate_robust

Array = np.ndarray
FEWEST = 3  # points that determine a floor
MARK_PX = 1.0  # px, standard deviation per axis of points that a person marks
WORST_PX = 10.0  # px, residual beyond which a mark is at another point or the calibration is wrong
FLAT = 0.02  # least extent of the points across their longest direction, relative to it


class MarkedFloor(NamedTuple):
    """Points on the floor, marked in images.

    Args:
        names: (N,) of the points. The first is the origin, the second is on the x axis.
        pixels: (N, C, 2) px by camera of the rig, NaN = not marked.
    """

    names: tuple[str, ...]
    pixels: Array


def world_on_floor(rig: Rig, floor: MarkedFloor) -> Rigid:
    """Return the world, z up with the floor at z = 0, from the rig's present world.

    Raises:
        CalibrationError: naming the point that is marked in one image only, or that the views contradict.
    """
    if len(floor.names) < FEWEST:
        raise CalibrationError(f"{len(floor.names)} points on the floor; mark at least {FEWEST}")
    views = np.isfinite(floor.pixels).all(axis=2).sum(axis=1)
    for name, count in zip(floor.names, views):
        if count < 2:
            raise CalibrationError(f"floor point {name} is marked in {count} image; mark it in at least two")
    plane = np.stack(
        [own.intrinsics.undistort(floor.pixels[:, c]) for c, own in enumerate(rig.cameras)], axis=1
    )
    sigmas = np.full(plane.shape[:2], MARK_PX)
    points = triangulate_robust(
        rig.stack(), plane, sigmas, gate=np.inf
    ).points  # no mark is left out silently
    for c, camera in enumerate(rig.cameras):
        misses = np.linalg.norm(camera.project(points)[0] - floor.pixels[:, c], axis=1)
        worst = int(np.argmax(np.nan_to_num(misses)))
        if not np.nan_to_num(misses[worst]) <= WORST_PX:
            raise CalibrationError(
                f"floor point {floor.names[worst]}: its mark in camera {camera.name} misses the point of the "
                f"other views by {misses[worst]:.0f} px; check the mark, or the calibration"
            )
    middle = points.mean(axis=0)
    _, extents, axes = np.linalg.svd(points - middle, full_matrices=False)
    if extents[1] < FLAT * extents[0]:
        raise CalibrationError("the floor points lie on one line; mark one beside it")
    centres = rig.stack().centres
    up = axes[2] if (centres - middle).mean(axis=0) @ axes[2] > 0.0 else -axes[2]
    origin = points[0] - up * ((points[0] - middle) @ up)
    along = points[1] - points[0]
    x = along - up * (along @ up)
    x = x / np.linalg.norm(x)
    rotation = np.stack([x, np.cross(up, x), up])
    return Rigid(rotation, -rotation @ origin)


def moved_rig(rig: Rig, new_from_old: Rigid) -> Rig:
    """Return the rig in a new world frame, with z up."""
    old_from_new = new_from_old.inverse()

    def moved(camera: Camera) -> Camera:
        covariance = camera.covariance
        if covariance is not None:  # t changes by R t_old: an error of R turns this part, too
            lever = camera.cam_from_world.rotation @ old_from_new.translation
            change = np.eye(len(covariance))
            change[3:6, :3] = np.cross(np.eye(3), lever).T
            covariance = change @ covariance @ change.T
        pose = camera.cam_from_world.compose(old_from_new)
        return replace(camera, cam_from_world=pose, covariance=covariance)

    things = rig.occluders
    return replace(
        rig,
        up=(0.0, 0.0, 1.0),
        cameras=tuple(moved(camera) for camera in rig.cameras),
        depth_sensors=tuple(replace(own, camera=moved(own.camera)) for own in rig.depth_sensors),
        occluders=None if things is None else replace(things, vertices=new_from_old.apply(things.vertices)),
    )


def scaled_rig(rig: Rig, factor: float) -> Rig:
    """Return the rig with all lengths multiplied by a factor."""

    def scaled(camera: Camera) -> Camera:
        covariance, pose = camera.covariance, camera.cam_from_world
        if covariance is not None:
            factors = np.ones(len(covariance))
            factors[3:6] = factor
            covariance = covariance * np.outer(factors, factors)
        return replace(
            camera, cam_from_world=Rigid(pose.rotation, factor * pose.translation), covariance=covariance
        )

    things = rig.occluders
    return replace(
        rig,
        cameras=tuple(scaled(camera) for camera in rig.cameras),
        depth_sensors=tuple(replace(own, camera=scaled(own.camera)) for own in rig.depth_sensors),
        occluders=None if things is None else replace(things, vertices=factor * things.vertices),
    )
