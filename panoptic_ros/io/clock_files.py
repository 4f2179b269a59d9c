"""Read and write clocks and line delays of cameras: `panoptic-clocks-1`, and the older `panoptic-offsets-1`.

master = timestamp + offset + drift * (timestamp - reference), and image row r is exposed r line delays later.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from panoptic_ros.domain import ClockModel, StampLine
from panoptic_ros.errors import DataError, shown
from panoptic_ros.io.documents import read_json
from panoptic_ros.io.files import write_json
from panoptic_ros.io.known_keys import EACH, keys, tell_unknown
from panoptic_ros.io.loading import parsing

if TYPE_CHECKING:
    from panoptic_ros.continuous.motion_result import ContinuousMotion
    from panoptic_ros.offsets.clocks import CameraClocks

FORMAT, OLDER = "panoptic-clocks-1", "panoptic-offsets-1"
KEYS = keys(
    "format reference_ns",
    cameras={
        EACH: keys(
            "offset_s offset_sd_s drift_ppm drift_sd_ppm line_delay_us line_delay_sd_us observable",
        )
    },
)
OLDER_KEYS = keys(
    "format reference_ns detector_bias_m iterations converged",
    cameras=[
        keys(
            "name applied known offset_s offset_std_s drift drift_std reference_ns strays_s rays "
            "joint_speed_m_per_s"
        )
    ],
)
SURE = 3.0  # standard deviations; a drift beyond them is significant
LARGEST_OFFSET_S = 4e9  # s, more than the time since 1970
LARGEST_DRIFT_PPM = 5000.0  # bad crystals deviate by 100
LARGEST_LINE_DELAY_US = 1000.0  # 1000 rows in 1 s


@dataclass(frozen=True, slots=True)
class SavedClock:
    """Clock and line delay of a camera, with standard deviations.

    Args:
        offset_s, offset_sd_s: added to timestamps at the reference.
        drift, drift_sd: change of the offset per time.
        reference_ns: None = first timestamp of the recording.
        line_delay_us, line_delay_sd_us: see `Camera`; None = not stated.
    """

    offset_s: float
    offset_sd_s: float = 0.0
    drift: float = 0.0
    drift_sd: float = 0.0
    reference_ns: int | None = None
    line_delay_us: float | None = None
    line_delay_sd_us: float = 0.0

    @property
    def drifts(self) -> bool:
        """Return whether the drift is significant, so that the offset is only valid for one recording."""
        return abs(self.drift) > SURE * self.drift_sd

    def line(self, first_ns: int, drifting: bool) -> StampLine:
        """Return the correction of timestamps.

        Args:
            first_ns: first timestamp of the recording.
            drifting: whether the drift counts.
        """
        reference = first_ns if self.reference_ns is None else self.reference_ns
        return StampLine(reference, round(1e9 * self.offset_s), self.drift if drifting else 0.0)


def write_camera_times(path: Path, motion: ContinuousMotion) -> None:
    """Write the clocks and line delays of a continuous motion. Offsets hold at its first view."""
    since = 1e-9 * (motion.first_ns - motion.reference_ns)
    values, covariance = motion.clocks.values, motion.clocks.covariance
    count = len(motion.cameras)
    deviations = motion.clocks.deviations
    observable = [bool(known) for known in motion.clocks.observable[[0, 2]].min(axis=0)]
    cameras = {}
    for c, name in enumerate(motion.cameras):
        offset, drift, line = values[:, c].tolist()
        variance = covariance[c, c] + 2.0 * since * covariance[c, count + c]
        variance += since * since * covariance[count + c, count + c]
        cameras[name] = {
            **_clock(offset + since * drift, float(max(variance, 0.0)) ** 0.5, drift, deviations[1, c]),
            "line_delay_us": 1e6 * line,
            "line_delay_sd_us": 1e6 * float(deviations[2, c]),
            "observable": observable[c],
        }
    _write(path, motion.first_ns, cameras)


def write_clocks(path: Path, clocks: CameraClocks, reference_ns: int) -> None:
    """Write the clock estimate of a recording.

    Args:
        reference_ns: first timestamp of the recording, or any other at which the offsets shall hold.
    """
    offsets, deviations = clocks.stated_at(np.full(len(clocks.cameras), reference_ns))
    observable: list[bool] = (clocks.known | clocks.applied).tolist()
    cameras = {
        name: {
            **_clock(offsets[c], deviations[c], clocks.drifts[c], clocks.drift_deviations[c]),
            "observable": observable[c],
        }
        for c, name in enumerate(clocks.cameras)
    }
    _write(path, reference_ns, cameras)


def write_models(path: Path, models: Mapping[str, ClockModel], delays: Mapping[str, StampLine]) -> None:
    """Write the final clock models of a run, added to the configured delays.

    Args:
        models: clock models by camera, at least one. The offsets hold at the newest of their references.
        delays: configured delays by camera. A camera with a delay but no model keeps the delay, without
            standard deviations.
    """
    reference = max(model.reference_ns for model in models.values())
    cameras = {
        name: _clock(1e-9 * (line.corrected(reference) - reference), 0.0, line.drift, 0.0)
        for name, line in delays.items()
    }
    for name, model in models.items():
        master, deviation = model.master_from_device(reference)
        line = delays.get(name, StampLine(0, 0))
        offset, drift = 1e-9 * (line.corrected(master) - reference), model.drift + line.drift
        cameras[name] = _clock(offset, 1e-9 * deviation, drift, np.sqrt(model.covariance[1, 1]))
    _write(path, reference, cameras)


def write_offsets(path: Path, offsets: Mapping[str, tuple[float, float, bool]], reference_ns: int) -> None:
    """Write constant clock offsets by camera: offset, s, standard deviation, s, whether it is observable."""
    cameras = {
        name: {**_clock(offset, deviation, 0.0, 0.0), "observable": observable}
        for name, (offset, deviation, observable) in offsets.items()
    }
    _write(path, reference_ns, cameras)


def read_clocks(path: Path) -> dict[str, SavedClock]:
    """Read the clocks that can be applied, by camera: those that were observable.

    Raises:
        DataError: naming the file and the fault.
    """
    document = read_json(path)
    found = document.get("format") if isinstance(document, dict) else None
    if found not in (FORMAT, OLDER):
        raise DataError(
            f"{path} is not a {FORMAT} file; `panoptic continuous --clocks-out` and `panoptic solve "
            "--offsets-out` write one"
        )
    tell_unknown(document, KEYS if found == FORMAT else OLDER_KEYS, path)
    with parsing(path):
        return _clocks(document) if found == FORMAT else _older(document)


def _write(path: Path, reference_ns: int, cameras: Mapping[str, Mapping[str, Any]]) -> None:
    write_json(path, {"format": FORMAT, "reference_ns": int(reference_ns), "cameras": dict(cameras)})


def _clock(offset: float, offset_sd: float, drift: float, drift_sd: float) -> dict[str, float | bool]:
    """Return the entries of a clock: offset in s, drift without unit, and standard deviations."""
    return {
        "offset_s": float(offset),
        "offset_sd_s": float(offset_sd),
        "drift_ppm": 1e6 * float(drift),
        "drift_sd_ppm": 1e6 * float(drift_sd),
    }


def _clocks(document: Mapping[str, Any]) -> dict[str, SavedClock]:
    reference = _reference(document)
    clocks = {}
    for name, row in document["cameras"].items():
        observable = row.get("observable", True)
        if not isinstance(observable, bool):
            raise ValueError(f"observable of {name} is {shown(observable)}, expected true or false")
        if observable:
            stated = row.get("line_delay_us") is not None
            line = _number(name, row, "line_delay_us", LARGEST_LINE_DELAY_US) if stated else None
            clocks[name] = SavedClock(
                _number(name, row, "offset_s", LARGEST_OFFSET_S),
                _number(name, row, "offset_sd_s", default=0.0),
                1e-6 * _number(name, row, "drift_ppm", LARGEST_DRIFT_PPM, 0.0),
                1e-6 * _number(name, row, "drift_sd_ppm", default=0.0),
                reference,
                line,
                _number(name, row, "line_delay_sd_us", default=0.0),
            )
    return clocks


def _older(document: Mapping[str, Any]) -> dict[str, SavedClock]:
    """Return the clocks of a file of the older format; a drift without a reference does not count."""
    clocks = {}
    for row in document["cameras"]:
        if row["applied"]:
            name, reference = str(row["name"]), _reference(row) or _reference(document)
            drift = _number(name, row, "drift", 1e-6 * LARGEST_DRIFT_PPM, 0.0)
            clocks[name] = SavedClock(
                _number(name, row, "offset_s", LARGEST_OFFSET_S),
                _number(name, row, "offset_std_s", default=0.0),
                0.0 if reference is None else drift,
                _number(name, row, "drift_std", default=0.0),
                reference,
            )
    return clocks


def _reference(table: Mapping[str, Any]) -> int | None:
    """Return the reference of a table, ns; None if it has none."""
    value = table.get("reference_ns")
    if value is None:
        return None
    if type(value) is not int or not 0 <= value < 2**63:
        raise ValueError(f"reference_ns is {shown(value)}, expected nanoseconds as an integer")
    return value


def _number(
    name: str,
    row: Mapping[str, Any],
    key: str,
    most: float = sys.float_info.max,
    default: float | None = None,
) -> float:
    """Return a number of a camera; its magnitude may be `most`. Without a default it must be there."""
    if default is None and key not in row:
        raise ValueError(f"{key} of {name} is missing")
    value = float(row.get(key, default))
    if not abs(value) <= most:  # also for NaN
        raise ValueError(f"{key} of {name} is {value:g}, expected at most {most:g}")
    return value
