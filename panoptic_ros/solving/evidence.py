"""The 2D people of all views of one instant as flat arrays, undistorted once."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain import AssociationSet, Camera, DetectionSet, Evidence, Rig, SkeletonModel
from panoptic_ros.errors import DataError
from panoptic_ros.solving.undistortion import lens_records, undistort_points

Array = np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class RigArrays:
    """The cameras of a rig as arrays, C cameras.

    Args:
        rotations (C, 3, 3), translations (C, 3) m: cam_from_world; centres (C, 3) m in the world.
        focals: (C,) px. lenses: (C,) see `lens_records`.
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
            np.ascontiguousarray(stack.centres), stack.focals, lens_records(rig),
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
