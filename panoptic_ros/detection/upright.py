"""How cameras are rolled about their optical axes, by the rig's up direction.

Networks find upright people. Images of rolled cameras are turned as they come (`preprocess.Turn`), and
everything in detection is in px of the upright image. Records are in px of the camera.
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
UPRIGHT = 30.0  # deg up to which images stay as they are: to turn them less than a quarter doubles their px
LEVEL = 10.0  # deg off a quarter turn up to which images are turned by that quarter turn
CONTRARY = 0.5  # cosine of the angle between two up axes, below which one of them is wrong
SURE = 0.7  # cosine of the angle between up and the tops of images, above which these tell up
AROUND, FEWEST = 0.25, 3  # spread and number of cameras, below which images tell no up: all may be rolled
NOT_KNOWN = (0.0, 0.0, 0.0)  # `DetectionConfig.up` where no file states it
FINDING = "`panoptic rig check RIG --detections FILE` finds from people which way is up"


@dataclass(frozen=True)
class Rolls:
    """How the images of a rig are turned.

    Args:
        degrees: counter-clockwise, by camera; cameras whose images stay as they are, are left out.
        notice: what a person should know of it, None: nothing.
    """

    degrees: Mapping[str, float]
    notice: Notice | None


def rolls_of(rig: Rig, up: Sequence[float] = ()) -> Rolls:
    """Tell by how much images of the cameras of a rig must be turned to be upright.

    Nothing is turned where up is not known, nor where all images are upright along another axis than up.

    Args:
        up: of the world; it replaces the rig's and is not questioned. `NOT_KNOWN`: no file states it.

    Raises:
        ConfigError: if `up` is no direction.
    """
    if len(up) not in (0, 3) or not np.isfinite(up).all():
        raise ConfigError(f"DetectionConfig.up = {shown(tuple(up))}, expected three finite numbers, or none")
    known = rig.up if not up else direction(up) if any(up) else None
    degrees = _turns(rig, known or Z_UP)
    if known is None:
        text = f"the rig does not state which way is up: +z is assumed, and no image is turned; {FINDING}"
        if degrees:
            text += f". If +z is up, images of {', '.join(degrees)} must be turned: --set detection.up=0,0,1"
        severity: Severity = "warning" if degrees else "info"
        return Rolls({}, Notice("detection.up", severity, text, {"cameras": list(degrees)}))
    if not degrees:
        return Rolls({}, None)
    seen = None if up else _up_of_untouched(rig)
    if seen is not None and abs(float(np.dot(seen, known))) < CONTRARY:
        text = (
            f"{_named(known)} is up in this rig, but images of all cameras are upright along {_named(seen)}, "
            f"so no image is turned; {FINDING}"
        )
        return Rolls({}, Notice("detection.up", "warning", text, {"cameras": list(degrees)}))
    turns: dict[str, list[str]] = {}
    for name, angle in degrees.items():
        way = "" if angle == 180.0 else " clockwise" if angle < 0.0 else " counter-clockwise"
        turns.setdefault(f"by {abs(angle):.0f} degrees{way}", []).append(name)
    listed = "; ".join(f"{', '.join(names)} {turn}" for turn, names in turns.items())
    text = f"images are turned upright for the network, as {_named(known)} is up: {listed}"
    return Rolls(degrees, Notice("detection.turned", "info", text, {"degrees": degrees}))


def _turns(rig: Rig, up: Direction) -> dict[str, float]:
    """Return degrees by camera, of those that are turned; almost a quarter turn is one."""
    found = {}
    for camera in rig.cameras:
        degrees = roll_of(camera, up)
        quarter = QUARTER * round(degrees / QUARTER)
        degrees = quarter if abs(degrees - quarter) <= LEVEL else degrees
        if abs(degrees) > UPRIGHT:
            found[camera.name] = 180.0 if degrees == -180.0 else degrees
    return found


def _up_of_untouched(rig: Rig) -> Direction | None:
    """Find the direction along which all images are upright as they are, if that is sure."""
    up = up_of_images(rig.cameras, [0] * len(rig), AROUND) if len(rig) >= FEWEST else None
    if up is None or min(-camera.cam_from_world.rotation[1] @ up for camera in rig.cameras) < SURE:
        return None
    return up


def _named(up: Direction) -> str:
    axis = int(np.argmax(np.abs(up)))
    if abs(up[axis]) > 0.99:
        return ("+" if up[axis] > 0.0 else "-") + "xyz"[axis]
    return "({:.2f}, {:.2f}, {:.2f})".format(*up)
