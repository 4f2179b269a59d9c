"""The 2D people of all views of one instant as flat arrays, undistorted once.

The undistortion is that of `Intrinsics.undistort`, of all 2D joints of all views in one compiled loop.
"""
from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from panoptic_ros.domain import AssociationSet, Camera, DetectionSet, Evidence, Rig, SkeletonModel
from panoptic_ros.errors import DataError
from panoptic_ros.kernels import njit
from panoptic_ros.solving.lens_kernels import fisheye_factor, fisheye_slope, straighten_fisheye

Array = np.ndarray
FARTHEST = 1e3  # undistorted radius beyond which no joint is believed
_NUMBERS = (
    "r00 r01 r02 r10 r11 r12 r20 r21 r22 tx ty tz ox oy oz fx skew cx fy cy k1 k2 p1 p2 k3 k4 fisheye fold "
    "limit width height columns rows a0 a1 a2 b0 b1 b2"
).split()
CAMERA = np.dtype([(name, np.float64) for name in _NUMBERS])  # see `camera_records`

_jit = njit(cache=True, error_model="numpy")


@dataclass(frozen=True, slots=True, eq=False)
class RigArrays:
    """The cameras of a rig as arrays, C cameras.

    Args:
        rotations (C, 3, 3), translations (C, 3) m: cam_from_world; centres (C, 3) m in the world.
        focals: (C,) px. lenses: (C,) see `camera_records`.
        boxes: (C, 4) m/m, the smallest and largest undistorted x and y that the image shows.
        diagonals: (C,) px. index: row of each camera by its name. cameras: the cameras of the rig.
    """

    rotations: Array
    translations: Array
    centres: Array
    focals: Array
    lenses: Array
    boxes: Array
    diagonals: Array
    index: dict[str, int]
    cameras: tuple[Camera, ...]

    @classmethod
    def of(cls, rig: Rig) -> RigArrays:
        """The arrays of a rig."""
        stack = rig.stack()
        return cls(
            np.ascontiguousarray(stack.rotations), np.ascontiguousarray(stack.translations),
            np.ascontiguousarray(stack.centres), stack.focals, camera_records(rig.cameras),
            np.stack([_plane_box(camera) for camera in rig.cameras]),
            np.array([float(np.hypot(*camera.image_size)) for camera in rig.cameras]),
            {name: i for i, name in enumerate(rig.names)},
            rig.cameras,
        )  # fmt: skip


def _plane_box(camera: Camera) -> Array:
    """Box (4,) m/m of the image on the undistorted plane, from the middles of its borders."""
    width, height = camera.image_size
    middle_x, middle_y = 0.5 * (width - 1), 0.5 * (height - 1)
    border = np.array([[-0.5, middle_y], [width - 0.5, middle_y], [middle_x, -0.5], [middle_x, height - 0.5]])
    plane = camera.intrinsics.undistort(border)
    box = np.array([plane[0, 0], plane[1, 0], plane[2, 1], plane[3, 1]])
    return np.where(np.isfinite(box), box, [-1e3, 1e3, -1e3, 1e3])


def gather(
    detections: DetectionSet, arrays: RigArrays, skeleton: SkeletonModel, skeleton_hash: str, min_score: float
) -> Evidence:
    """Flatten, order and undistort the 2D people of a set.

    Views are in the order of the rig. The people of a view are in an order that depends on their joints
    alone. So the order of the input does not matter. Derived joints are left out: their 2D points are no
    observations.

    Args:
        min_score: joints of a lower score count as missing.

    Raises:
        DataError: on another skeleton, a camera that the rig lacks, or other image sizes.
    """
    _check(detections, arrays, skeleton, skeleton_hash)
    slots = sorted(range(len(detections.views)), key=lambda i: arrays.index[detections.views[i].camera])
    records = [detections.views[i] for i in slots]
    cameras = np.array([arrays.index[record.camera] for record in records], np.int64)
    counts = [len(record.points) for record in records]
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    view = np.repeat(np.arange(len(records)), counts)
    joints = len(skeleton)
    pixels = np.concatenate([np.empty((0, joints, 2)), *(record.points for record in records)])
    scores = np.concatenate([np.empty((0, joints)), *(record.scores for record in records)])
    usable = (scores > 0.0) & (scores >= min_score)
    for joint, _ in skeleton.derived:
        usable[:, joint] = False
    keys = np.where(usable[..., None], pixels, 0.0).sum(axis=(1, 2))
    order = np.lexsort((keys, view))
    pixels, usable, scores = pixels[order], usable[order], scores[order]
    plane, magnification, good = undistort_points(pixels, usable, cameras[view], arrays.lenses)
    delays = np.array([1e-9 * (record.stamp_ns - detections.stamp_ns) for record in records])
    return Evidence(
        cameras, np.array(slots, np.int64), starts, view, order - starts[view], plane, magnification,
        np.where(good, scores, 0.0), delays,
    )  # fmt: skip


def carried_ages(detections: DetectionSet, evidence: Evidence) -> Array:
    """For how long (D,) s each 2D person was carried by motion; 0 = seen in its image."""
    ages = np.zeros(len(evidence.rows))
    for v, slot in enumerate(evidence.slots.tolist()):
        carried = detections.views[slot].carried
        if carried is not None:
            own = slice(evidence.starts[v], evidence.starts[v + 1])
            ages[own] = carried[evidence.rows[own]]
    return ages


def _check(
    detections: DetectionSet, arrays: RigArrays, skeleton: SkeletonModel, skeleton_hash: str
) -> None:
    """Raise DataError unless the set fits the rig and the skeleton."""
    if detections.skeleton_hash != skeleton_hash:
        raise DataError(
            f"detections of skeleton {detections.skeleton_hash}, but association works on "
            f"{skeleton.name} ({skeleton_hash}); configure one skeleton for all"
        )
    for record in detections.views:
        if record.camera not in arrays.index:
            raise DataError(
                f"detections of camera {record.camera!r}, which the rig lacks; it has "
                f"{', '.join(list(arrays.index)[:8])}"
            )
        if record.points.shape[1] != len(skeleton):
            raise DataError(
                f"camera {record.camera}: people of {record.points.shape[1]} joints, "
                f"skeleton {skeleton.name} has {len(skeleton)}"
            )
        if record.maps is not None and record.maps.joints.size and record.maps.joints.max() >= len(skeleton):
            raise DataError(
                f"camera {record.camera}: score maps of {record.maps.joints.max() + 1} joints, "
                f"skeleton {skeleton.name} has {len(skeleton)}"
            )
        size = arrays.cameras[arrays.index[record.camera]].image_size
        if record.image_size != size:
            raise DataError(
                f"camera {record.camera}: detections in an image of {record.image_size}, the rig says "
                f"{size}; rescale one of them"
            )


def check_association(
    item: AssociationSet, arrays: RigArrays, skeleton: SkeletonModel, skeleton_hash: str
) -> None:
    """Raise DataError unless associated people fit the rig and the skeleton of a later stage."""
    found, joints = item.detections.skeleton_hash, item.evidence.scores.shape[1]
    if found != skeleton_hash or joints != len(skeleton):
        raise DataError(
            f"people of skeleton {found} with {joints} joints in a stage that works on {skeleton.name} "
            f"({skeleton_hash}) with {len(skeleton)}; configure one skeleton for all"
        )
    for view in item.detections.views:
        if view.camera not in arrays.index:
            raise DataError(f"people of camera {view.camera!r}, which the rig lacks; configure one rig")
    if len(item.evidence.cameras) and item.evidence.cameras.max() >= len(arrays.cameras):
        raise DataError(
            f"people of camera number {item.evidence.cameras.max()}, but the rig has {len(arrays.cameras)}; "
            "configure one rig for all"
        )


@lru_cache(maxsize=256)
def camera_records(cameras: tuple[Camera, ...]) -> Array:
    """Cameras (C,) as kernels take them, not to be changed.

    Records `CAMERA`: rotation r00 to r22 and translation tx ty tz of cam_from_world; centre ox oy oz; matrix
    fx skew cx fy cy; terms of the lens k1 k2 p1 p2 k3, of a fisheye k1 k2 k3 k4; fisheye, 1 or 0; the
    undistorted radius at which the distortion folds back, squared (fold), and up to which points are
    undistorted (limit); width and height, px. The others are of score maps, see `VoteScene`, and 0.
    """
    records = np.zeros(len(cameras), CAMERA)
    for record, camera in zip(records, cameras):
        lens, pose = camera.intrinsics, camera.cam_from_world
        terms = (*lens.distortion, 0.0, 0.0)
        if lens.lens == "fisheye":
            terms = (*lens.distortion[:2], 0.0, 0.0, *lens.distortion[2:], 1.0)
        numbers = (
            *pose.rotation.ravel(), *pose.translation, *camera.centre, *lens.matrix.ravel()[[0, 1, 2, 4, 5]],
            *terms, lens.radius_limit**2, min(lens.radius_limit, FARTHEST), *camera.image_size,
        )  # fmt: skip
        for name, number in zip(_NUMBERS, numbers):
            record[name] = number
    return records


@_jit
def undistort_points(pixels, usable, cameras, lenses):
    """Undistorted normalised points by Newton's method.

    Args:
        pixels: (D, J, 2) px. usable: (D, J) bool. cameras: (D,) row of `lenses` (C,), see `camera_records`.

    Returns:
        plane (D, J, 2), 0 where unusable; magnification (D, J): how large a small thing of the plane is in
        the image, relative to one at the axis (1 with Brown lenses, where it hardly differs); good (D, J):
        usable and converged.
    """
    rows, joints = usable.shape
    plane = np.zeros((rows, joints, 2))
    magnification = np.ones((rows, joints))
    good = np.zeros((rows, joints), np.bool_)
    for d in range(rows):
        lens = lenses[cameras[d]]
        for j in range(joints):
            if not usable[d, j]:
                continue
            goal_y = (pixels[d, j, 1] - lens.cy) / lens.fy
            goal_x = (pixels[d, j, 0] - lens.cx - lens.skew * goal_y) / lens.fx
            if lens.fisheye > 0.0:
                x, y, zoom, found = _straighten(lens, goal_x, goal_y)
                magnification[d, j] = zoom if found else 1.0
            else:
                x, y, found = _undistort(lens, goal_x, goal_y)
            if found:
                plane[d, j, 0] = x
                plane[d, j, 1] = y
                good[d, j] = True
    return plane, magnification, good


@_jit
def _straighten(lens, goal_x, goal_y):
    """The undistorted point of a fisheye's, the magnification there, and whether there is one."""
    k1, k2, k3, k4 = lens.k1, lens.k2, lens.k3, lens.k4
    reached = np.sqrt(goal_x * goal_x + goal_y * goal_y)
    scale, found = straighten_fisheye(k1, k2, k3, k4, lens.limit, reached)
    x, y = scale * goal_x, scale * goal_y
    r2 = x * x + y * y
    across = fisheye_factor(k1, k2, k3, k4, r2)
    along = across + r2 * fisheye_slope(k1, k2, k3, k4, r2, across)
    return x, y, np.sqrt(across * max(along, 1e-6)), found


@_jit
def _undistort(lens, goal_x, goal_y):
    """The undistorted point of a Brown lens's, and whether there is one."""
    k1, k2, p1, p2, k3, limit = lens.k1, lens.k2, lens.p1, lens.p2, lens.k3, lens.limit
    straight = k1 == 0.0 and k2 == 0.0 and p1 == 0.0 and p2 == 0.0 and k3 == 0.0
    x, y = goal_x, goal_y
    miss = 0.0
    for _ in range(0 if straight else 20):
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3))
        miss_x = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) - goal_x
        miss_y = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y - goal_y
        miss = max(abs(miss_x), abs(miss_y))
        if miss < 1e-13:
            break
        xx = radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
        yy = radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
        xy = x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
        det = xx * yy - xy * xy
        if abs(det) < 1e-6:
            det = 1e-6
        x -= (yy * miss_x - xy * miss_y) / det
        y -= (xx * miss_y - xy * miss_x) / det
        radius = np.sqrt(x * x + y * y)
        if radius > limit:
            x *= limit / radius
            y *= limit / radius
    return x, y, miss < 1e-8
