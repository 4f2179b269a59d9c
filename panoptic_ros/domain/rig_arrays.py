"""Cameras of a rig as arrays for compiled kernels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from panoptic_ros.domain.camera import Camera
from panoptic_ros.domain.rig import Rig
from panoptic_ros.geometry import Intrinsics, brown

Array = np.ndarray
EDGE_POINTS = 33  # number of points sampled on each image border
FARTHEST = 1e3  # undistorted radius beyond which no point is used
_NUMBERS = (
    "r00 r01 r02 r10 r11 r12 r20 r21 r22 tx ty tz ox oy oz fx skew cx fy cy k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 "
    "s4 h00 h01 h02 h10 h11 h12 h20 h21 h22 fisheye many fold limit width height left right top bottom "
    "columns rows a0 a1 a2 b0 b1 b2"
).split()
CAMERA = np.dtype([(name, np.float64) for name in _NUMBERS])  # see `camera_records`


@dataclass(frozen=True, slots=True, eq=False)
class RigArrays:
    """Cameras of a rig as arrays, C cameras.

    Args:
        rotations: (C, 3, 3) of cam_from_world.
        translations: (C, 3) m of cam_from_world.
        centres: (C, 3) m in the world.
        focals: (C,) px.
        lenses: (C,) records, see `camera_records`.
        diagonals: (C,) px, image diagonals.
        line_delays: (C,) s from one image row to the next, 0 = global shutter.
        middles: (C,) s, exposure of the middle image row minus the timestamp.
        index: Row of each camera by name.
        cameras: The cameras of the rig.
    """

    rotations: Array
    translations: Array
    centres: Array
    focals: Array
    lenses: Array
    diagonals: Array
    line_delays: Array
    middles: Array
    index: dict[str, int]
    cameras: tuple[Camera, ...]

    @classmethod
    def of(cls, rig: Rig) -> RigArrays:
        """Return the arrays of a rig."""
        stack = rig.stack()
        return cls(
            np.ascontiguousarray(stack.rotations),
            np.ascontiguousarray(stack.translations),
            np.ascontiguousarray(stack.centres),
            stack.focals,
            camera_records(rig.cameras),
            np.array([float(np.hypot(*camera.image_size)) for camera in rig.cameras]),
            np.array([1e-6 * camera.line_delay_us for camera in rig.cameras]),
            np.array([camera.middle_s for camera in rig.cameras]),
            {name: i for i, name in enumerate(rig.names)},
            rig.cameras,
        )


@lru_cache(maxsize=256)
def camera_records(cameras: tuple[Camera, ...]) -> Array:
    """Return records (C,) of cameras for kernels. The array is cached: do not change it.

    Fields of a record `CAMERA`:
        r00 to r22, tx ty tz: rotation and translation of cam_from_world.
        ox oy oz: optical centre.
        fx skew cx fy cy: camera matrix.
        k1 to s4: lens terms as in `geometry.brown`; a fisheye uses k1 k2 k3 k4.
        h00 to h22: homography of a tilted sensor.
        fisheye: 1 or 0.
        many: 1 if a Brown lens has more than five terms, else 0.
        fold: squared undistorted radius at which the distortion folds back.
        limit: undistorted radius up to which points are undistorted.
        width, height: px.
        left, right, top, bottom: rectangle of the plane at 1 m whose points are all in the image; NaN for
            lenses that have none.
        others: fields of score maps, see `VoteScene`; 0 here.
    """
    records = np.zeros(len(cameras), CAMERA)
    for record, camera in zip(records, cameras):
        lens, pose = camera.intrinsics, camera.cam_from_world
        fisheye = lens.lens == "fisheye"
        numbers = (
            *pose.rotation.ravel(),
            *pose.translation,
            *camera.centre,
            *lens.matrix.ravel()[[0, 1, 2, 4, 5]],
            *_terms(lens),
            float(fisheye),
            float(not fisheye and len(lens.distortion) > 5),
            lens.radius_limit**2,
            min(lens.radius_limit, FARTHEST),
            *camera.image_size,
            *_rectangle(camera),
        )
        for name, number in zip(_NUMBERS, numbers):
            record[name] = number
    return records


def _rectangle(camera: Camera) -> tuple[float, float, float, float]:
    """Return left, right, top and bottom of the plane at 1 m: all points between them are in the image."""
    right, bottom = (size - 0.5 for size in camera.image_size)
    across, down = np.linspace(-0.5, right, EDGE_POINTS), np.linspace(-0.5, bottom, EDGE_POINTS)
    sides = [
        camera.intrinsics.undistort(np.stack(np.broadcast_arrays(x, y), axis=-1))
        for x, y in ((-0.5, down), (right, down), (across, -0.5), (across, bottom))
    ]
    (first, second, third, fourth) = sides
    return (
        float(first[:, 0].max()),
        float(second[:, 0].min()),
        float(third[:, 1].max()),
        float(fourth[:, 1].min()),
    )


def _terms(lens: Intrinsics) -> tuple[float, ...]:
    """Return the 12 terms of a lens and the 9 numbers of its homography, in the order of the records."""
    if lens.lens == "fisheye":
        k1, k2, k3, k4 = lens.distortion
        return (k1, k2, 0.0, 0.0, k3, k4, *(6 * (0.0,)), *np.eye(3).ravel())
    terms = np.zeros(12)
    count = min(len(lens.distortion), 12)
    terms[:count] = lens.distortion[:count]
    return (*terms, *brown.tilt(lens.distortion).ravel())
