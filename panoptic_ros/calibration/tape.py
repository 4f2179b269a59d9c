"""Distance of two cameras, to compare with one that is measured by a tape."""

from __future__ import annotations

import numpy as np

from panoptic_ros.calibration.projection import POSE
from panoptic_ros.calibration.solve import CalibratedRig

Array = np.ndarray
TAPE_SD_M = 0.005  # m, of a tape-measured distance of two lenses


def distance_of(rig: CalibratedRig, first: int, second: int) -> tuple[float, float]:
    """Return the distance, m, of two cameras and its standard deviation from the covariance of their poses.

    A pose error (turn, move) gives x = exp(turn) R X + t + move in the camera.
    """
    cameras = rig.state.cameras
    centres = -np.einsum("cji,cj->ci", cameras.rotations, cameras.translations)
    across = centres[first] - centres[second]
    apart = float(np.linalg.norm(across))
    slope = np.zeros(len(rig.covariance))
    for camera, sign in ((first, 1.0), (second, -1.0)):
        toward = sign * cameras.rotations[camera] @ across / max(apart, 1e-9)
        own = np.concatenate([np.cross(cameras.translations[camera], toward), -toward])
        rows = rig.index[camera, :POSE]
        slope[rows[rows >= 0]] += own[rows >= 0]
    return apart, float(np.sqrt(max(slope @ rig.covariance @ slope, 0.0)))
