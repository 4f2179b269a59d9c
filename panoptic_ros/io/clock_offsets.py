"""Read and write camera clock offsets estimated from motion, in the plain format `panoptic-offsets-1`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.domain import ClockModel
from panoptic_ros.errors import DataError
from panoptic_ros.io.documents import read_json
from panoptic_ros.io.files import write_json
from panoptic_ros.io.known_keys import keys, tell_unknown
from panoptic_ros.io.loading import parsing
from panoptic_ros.offsets import CameraClocks

FORMAT = "panoptic-offsets-1"
MORE = ("offset_std_s", "drift", "drift_std")  # keys that default to 0 if a file lacks them
KEYS = keys(
    "format reference_ns detector_bias_m iterations converged",
    cameras=[
        keys(
            "name applied known offset_s offset_std_s drift drift_std reference_ns strays_s rays "
            "joint_speed_m_per_s"
        )
    ],
)
SURE = 3.0  # standard deviations; a drift beyond them is significant


@dataclass(frozen=True, slots=True)
class SavedOffset:
    """Clock offset (s) to add to a camera's timestamps, clock drift (s/s), and their standard deviations."""

    offset_s: float
    offset_std_s: float = 0.0
    drift: float = 0.0
    drift_std: float = 0.0

    @property
    def drifts(self) -> bool:
        """Return whether the drift is significant, so that the offset is only valid for one recording."""
        return abs(self.drift) > SURE * self.drift_std


def write_clocks(path: Path, clocks: CameraClocks) -> None:
    """Write the clock estimate of a recording in SI units."""
    cameras = [
        {
            "name": name,
            "offset_s": float(clocks.offsets[c]),
            "offset_std_s": float(clocks.deviations[c]),
            "drift": float(clocks.drifts[c]),
            "drift_std": float(clocks.drift_deviations[c]),
            "known": bool(clocks.known[c]),
            "applied": bool(clocks.applied[c]),
            "strays_s": float(clocks.strays[c]),
            "joint_speed_m_per_s": float(clocks.speed[c]),
            "rays": int(clocks.rays[c]),
        }
        for c, name in enumerate(clocks.cameras)
    ]
    document = {
        "format": FORMAT,
        "reference_ns": clocks.reference_ns,
        "detector_bias_m": clocks.bias,
        "iterations": clocks.iterations,
        "converged": clocks.converged,
        "cameras": cameras,
    }
    write_json(path, document)


def write_models(path: Path, models: Mapping[str, ClockModel], delays_ms: Mapping[str, float]) -> None:
    """Write the final clock models of a run, added to the configured delays.

    Args:
        models: clock models by camera.
        delays_ms: configured delays by camera, ms. A camera with a delay but no model keeps the delay,
            without a standard deviation.
    """
    rows: dict[str, dict[str, Any]] = {
        name: {"name": name, "applied": True, "offset_s": 1e-3 * delay} for name, delay in delays_ms.items()
    }
    for name, model in models.items():
        given = rows.get(name, {"offset_s": 0.0})["offset_s"]
        rows[name] = {
            "name": name,
            "applied": True,
            "offset_s": given + 1e-9 * model.offset_ns,
            "offset_std_s": float(np.sqrt(model.covariance[0, 0])),
            "drift": model.drift,
            "drift_std": float(np.sqrt(model.covariance[1, 1])),
            "reference_ns": model.reference_ns,
        }
    write_json(path, {"format": FORMAT, "cameras": list(rows.values())})


def read_offsets(path: Path) -> dict[str, SavedOffset]:
    """Read the offsets marked as applied, by camera.

    Raises:
        DataError: naming the file and the fault.
    """
    document = read_json(path)
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise DataError(f"{path} is no {FORMAT} file; --offsets-out of `panoptic solve` writes one")
    tell_unknown(document, KEYS, path)
    with parsing(path):
        return {
            str(row["name"]): SavedOffset(_number(row, "offset_s"), *(_number(row, key, 0.0) for key in MORE))
            for row in document["cameras"]
            if row["applied"]
        }


def _number(row: Mapping[str, Any], key: str, default: float | None = None) -> float:
    value = float(row[key] if default is None else row.get(key, default))
    if not math.isfinite(value):
        raise ValueError(f"{key} of {row['name']} is {value}")
    return value
