"""Skeletons of segments, pose priors and recorded motions that are installed, or in files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from panoptic_ros.domain.body_shape import BodyShape, read_shape
from panoptic_ros.domain.segments import SegmentModel, read_model
from panoptic_ros.errors import DataError
from panoptic_ros.io.files import file_errors, read_yaml
from panoptic_ros.io.resources import share_folder
from panoptic_ros.kinematics.prior import PoseStatistics
from panoptic_ros.simulation.bodies.motion import Clip, clips_of

DEFAULT_MODEL = "segments21"
DEFAULT_SHAPE = "shape21"
DEFAULT_PRIOR = "prior-cmu.npz"
MOTION = "cmu-motion.npz"
PRIOR_KEYS = ("mean", "components", "deviations", "spreads")


def read_body_model(name: str = DEFAULT_MODEL) -> SegmentModel:
    """A skeleton of segments by the name of an installed one or the path of a YAML file.

    Raises:
        DataError: if there is none, or it is not as it must be.
    """
    path = Path(name)
    if path.suffix not in (".yaml", ".yml"):
        path = share_folder() / "config" / "bodies" / f"{name}.yaml"
    document = read_yaml(path)
    if not isinstance(document, dict):
        raise DataError(f"{path} is no skeleton of segments")
    return read_model(document)


def read_body_shape(model: SegmentModel, name: str = DEFAULT_SHAPE) -> BodyShape:
    """How thick bodies are, as installed.

    Raises:
        DataError: if it cannot be read.
    """
    path = share_folder() / "config" / "bodies" / f"{name}.yaml"
    document = read_yaml(path)
    if not isinstance(document, dict):
        raise DataError(f"{path} is no shape of a body")
    return read_shape(document, model)


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
