"""What a node asks of a camera's record before its stage sees it."""
from __future__ import annotations

from panoptic_ros.domain import Rig, SkeletonModel, ViewDetections, ViewFrame
from panoptic_ros.errors import DataError


def check_view(view: object, camera: str, rig: Rig, skeleton: SkeletonModel) -> None:
    """Whether a view is of the camera that its topic belongs to, as the rig and the skeleton describe it.

    Args:
        view: a `ViewFrame` or `ViewDetections`; of other records nothing is asked here.

    Raises:
        DataError: naming what is different.
    """
    if not isinstance(view, (ViewFrame, ViewDetections)):
        return
    if view.camera != camera:
        raise DataError(f"a message of camera {view.camera!r} came on a topic of {camera}")
    calibrated = rig.camera(camera).image_size
    if view.image_size != calibrated:
        sizes = [f"{width} x {height}" for width, height in (view.image_size, calibrated)]
        raise DataError(f"images of camera {camera} are {sizes[0]}, but it is calibrated for {sizes[1]}")
    if isinstance(view, ViewDetections) and view.points.shape[1] != len(skeleton.joint_names):
        raise DataError(
            f"detections of camera {camera} have {view.points.shape[1]} joints, {skeleton.name} has "
            f"{len(skeleton.joint_names)}"
        )
