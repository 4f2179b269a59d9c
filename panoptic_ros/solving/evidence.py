"""The 2D people of all views of one instant as flat arrays, undistorted once."""
from __future__ import annotations

import numpy as np

from panoptic_ros.domain import AssociationSet, DetectionSet, Evidence, SkeletonModel
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.errors import DataError
from panoptic_ros.geometry.lens_kernels import undistort_points

Array = np.ndarray

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
