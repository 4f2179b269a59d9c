"""The statistics of poses that are installed, or in a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from panoptic_ros.errors import DataError
from panoptic_ros.io.files import file_errors
from panoptic_ros.io.resources import share_folder
from panoptic_ros.kinematics.pose.prior import PoseStatistics

DEFAULT_PRIOR = "prior-cmu.npz"
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
