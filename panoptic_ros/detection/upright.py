"""Rotation that makes each camera's images upright, from the rig's up direction.

Networks detect upright people. So the images of rolled cameras are rotated on arrival
(`preprocess.ImageRotation`), and all coordinates inside detection are px of the upright image. Records are in
px of the camera.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain import Rig
from panoptic_ros.domain.upright import Z_UP, Direction, direction, roll_of, up_of_images
from panoptic_ros.errors import ConfigError, shown
from panoptic_ros.stage import Notice, Severity

QUARTER = 90.0  # deg
UPRIGHT = 30.0  # deg, largest roll left uncorrected: rotating by less than a quarter turn may double the px
LEVEL = 10.0  # deg, largest distance from a quarter turn at which the exact quarter turn is used
CONTRARY = 0.5  # cosine of the angle between two up axes, below which one of them is wrong
SURE = 0.7  # least cosine of the angle between up and the tops of images, for images to define up
# Least spread of image rows, and least number of cameras, for images to define up: otherwise all of them may
# be rolled.
AROUND, FEWEST = 0.25, 3
NOT_KNOWN = (0.0, 0.0, 0.0)  # value of `DetectionConfig.up` if no file states up
FINDING = "`panoptic rig check RIG --detections FILE` finds the up direction from people"


@dataclass(frozen=True)
class CameraRolls:
    """Rotations of the images of a rig.

    Args:
        degrees: Counter-clockwise rotation by camera. Cameras whose images stay unchanged are left out.
        notice: Message for the user; None: no message.
    """

    degrees: Mapping[str, float]
    notice: Notice | None


def rolls_of(rig: Rig, up: Sequence[float] = ()) -> CameraRolls:
    """Return the rotations that make the images of a rig's cameras upright.

    No image is rotated in two cases: if up is unknown, or if all images are upright along another axis than
    up.

    Args:
        up: up direction of the world. It overrides the rig's and is not questioned. `NOT_KNOWN`: no file
            states it.

    Raises:
        ConfigError: if `up` does not have 0 or 3 finite numbers.
    """
    if len(up) not in (0, 3) or not np.isfinite(up).all():
        raise ConfigError(f"DetectionConfig.up = {shown(tuple(up))}, expected three finite numbers, or none")
    known = rig.up if not up else direction(up) if any(up) else None
    degrees = _turns(rig, known or Z_UP)
    if known is None:
        text = f"the rig does not state its up direction: +z is assumed, and no image is turned; {FINDING}"
        if degrees:
            text += f". If +z is up, images of {', '.join(degrees)} must be turned: --set detection.up=0,0,1"
        severity: Severity = "warning" if degrees else "info"
        return CameraRolls({}, Notice("detection.up", severity, text, {"cameras": list(degrees)}))
    if not degrees:
        return CameraRolls({}, None)
    seen = None if up else _up_of_untouched(rig)
    if seen is not None and abs(float(np.dot(seen, known))) < CONTRARY:
        text = (
            f"{_named(known)} is up in this rig, but images of all cameras are upright along {_named(seen)}, "
            f"so no image is turned; {FINDING}"
        )
        return CameraRolls({}, Notice("detection.up", "warning", text, {"cameras": list(degrees)}))
    turns: dict[str, list[str]] = {}
    for name, angle in degrees.items():
        way = "" if angle == 180.0 else " clockwise" if angle < 0.0 else " counter-clockwise"
        turns.setdefault(f"by {abs(angle):.0f} degrees{way}", []).append(name)
    listed = "; ".join(f"{', '.join(names)} {turn}" for turn, names in turns.items())
    text = f"images are turned upright for the network, as {_named(known)} is up: {listed}"
    return CameraRolls(degrees, Notice("detection.turned", "info", text, {"degrees": degrees}))


def _turns(rig: Rig, up: Direction) -> dict[str, float]:
    """Return degrees by camera, of the rotated cameras; a near quarter turn becomes an exact one."""
    found = {}
    for camera in rig.cameras:
        degrees = roll_of(camera, up)
        quarter = QUARTER * round(degrees / QUARTER)
        degrees = quarter if abs(degrees - quarter) <= LEVEL else degrees
        if abs(degrees) > UPRIGHT:
            found[camera.name] = 180.0 if degrees == -180.0 else degrees
    return found


def _up_of_untouched(rig: Rig) -> Direction | None:
    """Find the direction along which all unrotated images are upright; None if that is not sure."""
    up = up_of_images(rig.cameras, [0] * len(rig), AROUND) if len(rig) >= FEWEST else None
    if up is None or min(-camera.cam_from_world.rotation[1] @ up for camera in rig.cameras) < SURE:
        return None
    return up


def _named(up: Direction) -> str:
    axis = int(np.argmax(np.abs(up)))
    if abs(up[axis]) > 0.99:
        return ("+" if up[axis] > 0.0 else "-") + "xyz"[axis]
    return "({:.2f}, {:.2f}, {:.2f})".format(*up)
