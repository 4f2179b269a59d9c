"""Recorded motions that are installed, or in files, and the statistics of poses that were made of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from panoptic_ros.errors import DataError
from panoptic_ros.io.files import file_errors
from panoptic_ros.io.resources import share_folder
from panoptic_ros.kinematics.prior import PoseStatistics
from panoptic_ros.simulation.bodies.motion import Clip, clips_of

DEFAULT_PRIOR = "prior-cmu.npz"
MOTION = "cmu-motion.npz"
PRIOR_KEYS = ("mean", "components", "deviations", "spreads")


def read_prior(name: str = "") -> PoseStatistics:
    """Statistics of poses by the path of a file, or those installed.

    Raises:
        DataError: if the file is not as it must be.
    """
    path = Path(name) if name else share_folder() / "config" / "bodies" / DEFAULT_PRIOR
    with file_errors(path, "read"), np.load(path) as found:
        try:
            arrays = [found[key] for key in PRIOR_KEYS]
        except KeyError as error:
            raise DataError(f"{path} is no pose prior, or an old one ({error}): train it anew") from None
    return PoseStatistics(*(np.ascontiguousarray(array, np.float64) for array in arrays))


def read_clips(path: Path | None = None) -> dict[str, Clip]:
    """Recorded motions of our skeleton in a file; none if it has other things. None = those installed, see
    NOTICE for where they are from."""
    path = path or share_folder() / "config" / "bodies" / MOTION
    with file_errors(path, "read"), np.load(path) as found:
        arrays = dict(found)
    ours = "clips" in arrays and all(f"vectors_{name}" in arrays for name in arrays["clips"])
    return clips_of(arrays) if ours else {}
