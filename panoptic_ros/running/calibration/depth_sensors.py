"""Depth sensors of a rig from a board: their poses, their colour cameras and the scale of their depth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from panoptic_ros.calibration.depth_scale import SeenDepths, depth_scale
from panoptic_ros.calibration.projection import POSE
from panoptic_ros.calibration.solve import CalibratedRig
from panoptic_ros.domain import DepthSensor, Rig
from panoptic_ros.errors import UsageError

NO_SENSORS: Mapping[str, str] = {}
UNIT_M = 1e-3  # m, nominal unit of depth maps
CERTAIN = 3.0  # standard deviations from 1 at which a scale is reported


def sensors_of(words: Sequence[str]) -> dict[str, str]:
    """Return the colour camera by infrared camera of words INFRARED=COLOUR.

    Raises:
        UsageError: on other text.
    """
    pairs = [word.partition("=") for word in words]
    for word, (infrared, _, colour) in zip(words, pairs):
        if not (infrared and colour):
            raise UsageError(f"--depth-sensor {word}: write INFRARED=COLOUR, e.g. kinect_ir=kinect")
    return {infrared: colour for infrared, _, colour in pairs}


def check_sensors(names: Sequence[str], sensors: Mapping[str, str]) -> None:
    """Check that depth sensors and their colour cameras are in the recording.

    Raises:
        UsageError: naming the one that is not.
    """
    for infrared, colour in sensors.items():
        for name in (infrared, colour):
            if name not in names:
                raise UsageError(
                    f"--depth-sensor {infrared}={colour}: no camera {name}; there are {', '.join(names)}"
                )
        if infrared == colour:
            raise UsageError(f"--depth-sensor {infrared}={colour}: give two different cameras")


def with_depth_sensors(
    rig: Rig, solved: CalibratedRig, depths: Sequence[SeenDepths], sensors: Mapping[str, str]
) -> tuple[Rig, list[str]]:
    """Return the rig with cameras of infrared images as depth sensors, and lines about the scale of depth.

    Args:
        depths: Depth at the corners of the board.
        sensors: Colour camera by infrared camera.
    """
    lines, found = [], []
    for c, camera in enumerate(rig.cameras):
        fit = depth_scale(solved, c, depths)
        unit_m = UNIT_M
        # an error of the focal length moves the board by the same share
        focal = float(solved.sd(c, slice(POSE, POSE + 1))[0] / solved.state.cameras.lenses[c, 0])
        sd = float(np.hypot(fit.sd, focal)) if fit is not None else 0.0
        if fit is not None and abs(fit.scale - 1.0) > CERTAIN * sd:
            wrong = "short" if fit.scale > 1.0 else "long"
            lines.append(
                f"camera {camera.name}: depth is {abs(fit.scale - 1.0):.2%} ± {sd:.2%} too {wrong}"
                + ("; rig.json corrects its unit" if camera.name in sensors else "; correct its driver")
            )
        if camera.name in sensors:
            unit_m *= fit.scale if fit is not None else 1.0
            found.append(DepthSensor(camera, sensors[camera.name], unit_m))
            if fit is None:
                lines.append(
                    f"depth sensor {camera.name}: too few depth maps show the board; its unit is 1 mm"
                )
    kept = tuple(camera for camera in rig.cameras if camera.name not in sensors)
    return replace(rig, cameras=kept, depth_sensors=tuple(found)), lines
