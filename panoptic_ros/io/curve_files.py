"""Write curves of people, which can be evaluated later at any instant."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.continuous.motion_result import ContinuousMotion
from panoptic_ros.io.files import write_bytes


def write_curves(path: Path, joint_names: Sequence[str], motion: ContinuousMotion) -> None:
    """Write control points, knots and covariances of all people as NumPy's .npz.

    `scipy.interpolate.BSpline(knots_k, points_k, 4)` of curve k gives m at s after `reference_ns`.
    """
    arrays: dict[str, Any] = {
        "format": np.array("panoptic-curves-1"),
        "joint_names": np.array(list(joint_names)),
        "reference_ns": np.int64(motion.reference_ns),
        "ids": np.array([person.id for person in motion.people], np.int64),
    }
    for k, person in enumerate(motion.people):
        grid = person.grid
        arrays[f"knots_{k}"] = grid.origin + grid.step * np.arange(-4, grid.number + 1)
        arrays[f"points_{k}"] = person.points
        arrays[f"covariances_{k}"] = person.covariances.astype(np.float32)
        arrays[f"seen_{k}"] = person.seen
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    write_bytes(path, buffer.getvalue())
