"""Read and write pose priors: statistics of poses, installed or from a file."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.errors import DataError, one_line
from panoptic_ros.io.arrays import arrays_of
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.files import write_bytes
from panoptic_ros.io.loading import parsing
from panoptic_ros.io.resources import share_folder
from panoptic_ros.kinematics.pose.prior import PoseStatistics

DEFAULT_PRIOR = "prior-cmu.npz"
PRIOR_KEYS = ("mean", "components", "deviations", "spreads")


SEGMENTS = "segments"  # key of the segment names; files without it use the installed skeleton


def read_prior(name: str = "", model: SegmentModel | None = None) -> PoseStatistics:
    """Read the pose statistics of a file, or the installed ones.

    Args:
        name: path of a file; "" = the installed prior.
        model: segment skeleton to which the statistics are converted; None = their own skeleton.

    Raises:
        DataError: if the file does not follow the format, or has none of the segments.
    """
    path = Path(name) if name else share_folder() / "config" / "bodies" / DEFAULT_PRIOR
    with arrays_of(path) as found:
        try:
            arrays = [found[key] for key in PRIOR_KEYS]
        except KeyError as error:
            told = f"{path} is not a pose prior, or an old one ({one_line(error)})"
            raise DataError(f"{told}: train it again") from None
        own = tuple(map(str, found[SEGMENTS])) if SEGMENTS in found else read_body_model().names
    with parsing(path):
        _check_shapes(arrays, path)
        statistics = PoseStatistics(*(np.ascontiguousarray(array, np.float64) for array in arrays))
        try:
            return statistics.of_other_segments(own, own if model is None else model.names)
        except DataError as error:
            raise DataError(f"{path}: {error}") from None


def _check_shapes(arrays: Sequence[np.ndarray], path: Path) -> None:
    """Check that the arrays are finite numbers of the shapes (N,), (N, K), (K,), (N,).

    Raises:
        DataError: if not, or if a deviation is not positive or a spread is negative.
    """
    mean, _, deviations, spreads = arrays
    shapes = [array.shape for array in arrays]
    count, kept = mean.shape[:1], deviations.shape[:1]
    if shapes != [count, count + kept, kept, count]:
        raise DataError(
            f"{path} is not a pose prior: its arrays have the shapes {', '.join(map(str, shapes))}"
        )
    for key, array in zip(PRIOR_KEYS, arrays):
        if array.dtype.kind not in "fiu" or not np.isfinite(array).all():
            raise DataError(f"{path} is not a pose prior: {key} has something that is not a finite number")
    if not (deviations > 0.0).all() or not (spreads >= 0.0).all():
        raise DataError(f"{path} is not a pose prior: a deviation is 0 or negative")


def write_prior(path: Path, statistics: PoseStatistics, model: SegmentModel) -> None:
    """Write the pose statistics of a segment skeleton."""
    memory = io.BytesIO()
    arrays: dict[str, Any] = {key: getattr(statistics, key).astype(np.float32) for key in PRIOR_KEYS}
    np.savez_compressed(memory, **arrays | {SEGMENTS: np.array(model.names)})
    write_bytes(path, memory.getvalue())
