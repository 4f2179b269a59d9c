"""Opening a live camera of a rig."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from panoptic_ros.capture.device import DeviceOptions, DeviceSource
from panoptic_ros.capture.image_size import fit_camera
from panoptic_ros.domain import Rig


def open_live(camera: str, rig: Rig, device: str, options: Mapping[str, Any]) -> DeviceSource:
    """A device that gives images of the size for which the camera is calibrated.

    Args:
        options: of `DeviceOptions`, as plain values.

    Raises:
        BackendError: if it cannot be opened.
        CalibrationError: if its images have another size.
    """
    calibrated = rig.camera(camera)
    wishes = DeviceOptions(**{"image_size": calibrated.image_size, **options})
    source = DeviceSource(camera, device, options=wishes)
    try:
        fit_camera(calibrated, source.image_size)
    except BaseException:
        source.close()
        raise
    return source
