"""Read and write IMU samples (`imu.csv`) and designated persons (`subject.json`).

docs/bodies.md lists every key.
"""

from __future__ import annotations

import gzip
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.domain.subjects import Device, ImuSeries, Subject, TPose
from panoptic_ros.errors import DataError, shown
from panoptic_ros.geometry.rotations import from_quaternions, to_quaternions
from panoptic_ros.io.documents import csv_rows, decoded, read_json
from panoptic_ros.io.files import write_bytes
from panoptic_ros.io.known_keys import EACH, keys, tell_unknown
from panoptic_ros.io.loading import parsing, read_unpacked

Array = np.ndarray
SUBJECT = "panoptic-subject-1"
LARGEST = 1e6  # m, limit of coordinates and lengths
INERTIAL_FRAMES = ("world", "unknown heading")
KEYS = keys(
    "format id height_m inertial_frame segments start",
    keypoints={EACH: keys("segment offset")},
    devices=[keys("device segment position mount")],
    t_pose=keys("from_ns to_ns facing"),
)
# Fraction of timestamps shared by several samples from which the samples of a device come in batches.
BATCHED = 0.5
# Limit of the sample step in a batch, as a multiple of the median step. A longer step is a gap after the
# batch.
LONGER = 1.5
COLUMNS = ("device", "stamp_ns", "qw", "qx", "qy", "qz", "gx", "gy", "gz", "ax", "ay", "az")


def read_imus(path: Path, notices: list[str] | None = None) -> dict[str, ImuSeries]:
    """Read the samples of all devices of an `imu.csv`, gzipped or not.

    If samples come in batches with a shared timestamp, they are spread forward from it at the sample rate.
    Otherwise a sample is skipped if its timestamp is not later than the previous one of its device.

    Args:
        notices: receives lines about devices whose samples are spread or skipped.

    Raises:
        DataError: naming the file, the line and the fault.
    """
    rows = csv_rows(decoded(read_unpacked(path), path), path)
    _, header = next(rows, (1, []))
    if tuple(header) != COLUMNS:
        raise DataError(f"{path}: the header is {shown(','.join(header), 80)}, expected {','.join(COLUMNS)}")
    stamps: dict[str, list[int]] = {}
    values: dict[str, list[list[float]]] = {}
    for number, row in rows:
        if not row:
            continue
        try:
            name, stamp = row[0], int(row[1])
            numbers = [float(text) if text else np.nan for text in row[2:]]
        except (ValueError, IndexError):
            numbers = []
        if len(numbers) != len(COLUMNS) - 2 or abs(stamp) >= 2**63:
            said = shown(",".join(row), 80)
            raise DataError(f"{path}, line {number}: {said} is not a sample of an IMU")
        stamps.setdefault(name, []).append(stamp)
        values.setdefault(name, []).append(numbers)
    told: dict[str, list[str]] = {}
    found = {}
    for name, rows_of in values.items():
        table = np.array(rows_of)
        table[~np.isfinite(table)] = np.nan
        times, kept, line = _in_order(np.array(stamps[name]))
        if line:
            told.setdefault(line, []).append(name)
        if len(times):
            found[name] = ImuSeries(times, table[kept, :4], table[kept, 4:7], table[kept, 7:])
    if notices is not None:
        notices += [f"{', '.join(names)}: {line}" for line, names in told.items()]
    return found


def _in_order(stamps: Array) -> tuple[Array, Array, str]:
    """Return increasing timestamps (M,) ns, their rows (M,) in the input, and a notice ("" if unchanged).

    Args:
        stamps: timestamps (N,) ns of the samples of one device.
    """
    newest = np.maximum.accumulate(np.maximum(stamps, -1))
    new = np.append(newest[:1] >= 0, newest[1:] > newest[:-1])
    if new.all():
        return stamps, np.flatnonzero(new), ""
    begins = np.flatnonzero(new)
    repeated = (stamps == newest) & (stamps >= 0)
    sizes = np.add.reduceat(repeated.astype(int), begins) if len(begins) else np.zeros(0, int)
    if len(begins) < 2 or (sizes > 1).mean() < BATCHED:
        line = f"{int((~new).sum())} samples are left out, as their stamps are repeated or go back"
        return stamps[new], begins, line
    steps = np.diff(stamps[begins])
    period = float(np.median(steps / sizes[:-1]))
    each = np.append(np.minimum(steps / sizes[:-1], LONGER * period), period)  # ns between samples of a batch
    rows = np.flatnonzero(repeated)
    batch = np.cumsum(new)[rows] - 1
    places = np.arange(len(rows)) - np.append(0, np.cumsum(sizes))[batch]
    times = np.maximum.accumulate(stamps[rows] + np.round(places * each[batch]).astype(np.int64))
    rising = np.append(True, times[1:] > times[:-1])
    times, rows = times[rising], rows[rising]
    line = f"samples come several to a stamp; they are spread by their rate, {1e9 / period:.1f} Hz"
    lost = len(stamps) - len(rows)
    return times, rows, line + (f"; {lost} left out, as their stamps go back" if lost else "")


def write_imus(path: Path, devices: Mapping[str, ImuSeries]) -> None:
    """Write samples, ordered by timestamp and device."""
    rows = sorted(
        (int(stamp), name, k) for name, series in devices.items() for k, stamp in enumerate(series.stamps)
    )
    lines = [",".join(COLUMNS)]
    for stamp, name, k in rows:
        series = devices[name]
        parts = ((series.quaternions, 6), (series.rates, 5), (series.forces, 4))
        numbers = ["" if np.isnan(v) else f"{v:.{digits}f}" for table, digits in parts for v in table[k]]
        lines.append(",".join([name, str(stamp), *numbers]))
    data = ("\n".join(lines) + "\n").encode()
    write_bytes(path, gzip.compress(data, mtime=0) if path.name.endswith(".gz") else data)


def read_subject(path: Path, model: SegmentModel) -> Subject:
    """Read a designated person from a `panoptic-subject-1` file.

    Raises:
        DataError: naming the file, the key and the fault.
    """
    document = read_json(path)
    if not isinstance(document, dict) or document.get("format") != SUBJECT:
        raise DataError(f"{path} is not a {SUBJECT} file")
    tell_unknown(document, KEYS, path)
    with parsing(path):
        return _subject(document, model, path)


def _subject(document: dict[str, Any], model: SegmentModel, path: Path) -> Subject:
    try:
        stature = float(document["height_m"])
        body = model.body(stature)
        body = body.with_offsets(
            {name: _bone(v, name, stature) for name, v in (document.get("segments") or {}).items()}
        )
        keypoints = document.get("keypoints") or {}
        body = body.with_keypoints(
            {name: (row["segment"], _vector(row["offset"], 3, name)) for name, row in keypoints.items()}
        )
        devices = tuple(_device(row, model) for row in document.get("devices") or ())
        start = document.get("start")
        return Subject(
            _id(document["id"]),
            body,
            _distinct(devices),
            _t_pose(document.get("t_pose")),
            None if start is None else _vector(start, 3, "start"),
            _heading_known(document.get("inertial_frame", "world")),
            bool(document.get("segments")),
            stature,
            _assumed(document, devices),
        )
    except DataError as error:
        raise DataError(f"{path}: {error}") from None


def _assumed(document: Mapping[str, Any], devices: Sequence[Device]) -> tuple[str, ...]:
    """Return lines about default values of keys that the file omits and the person needs."""
    found = []
    if not document.get("segments"):
        found.append("lengths of segments as usual for height_m")
    if devices and "inertial_frame" not in document:
        found.append('inertial_frame "world", with an x axis common to the IMUs')
    t_pose, unmounted = document.get("t_pose"), any(device.mount is None for device in devices)
    if unmounted and t_pose is not None and t_pose.get("facing") is None:
        found.append("facing +x in the t_pose")
    lacking = [str(row["device"]) for row in document.get("devices") or () if "position" not in row]
    if lacking:
        found.append(f"position of {', '.join(lacking)} at the beginning of its segment")
    return tuple(found)


def subject_document(subject: Subject) -> dict[str, Any]:
    """Return the `panoptic-subject-1` document of a person, with segment lengths, keypoints and devices."""
    names = subject.body.model.names
    found: dict[str, Any] = {
        "format": SUBJECT,
        "id": subject.id,
        "height_m": round(subject.stature, 4),
        "inertial_frame": "world" if subject.heading_known else "unknown heading",
        "segments": {name: _rounded(o) for name, o in zip(names, subject.body.offsets)},
        "keypoints": {
            name: {"segment": names[s], "offset": _rounded(o)}
            for name, (s, o) in subject.body.keypoints.items()
        },
        "devices": [
            {"device": d.name, "segment": names[d.segment], "position": _rounded(d.position)}
            | ({} if d.mount is None else {"mount": _rounded(to_quaternions(d.mount), 6)})
            for d in subject.devices
        ],
    }
    if subject.start is not None:
        found["start"] = _rounded(subject.start, 3)
    if subject.t_pose is not None:
        found["t_pose"] = {"from_ns": subject.t_pose.from_ns, "to_ns": subject.t_pose.to_ns}
        if subject.t_pose.facing is not None:
            found["t_pose"]["facing"] = _rounded(subject.t_pose.facing)
    return found


def _id(value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise DataError(f"id = {shown(value)}; ids of subjects are whole numbers and count from 0")
    return value


def _distinct(devices: tuple[Device, ...]) -> tuple[Device, ...]:
    names = [device.name for device in devices]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise DataError(f"device {twice} is listed twice; each is on one segment")
    return devices


def _heading_known(frame: Any) -> bool:
    if frame not in INERTIAL_FRAMES:
        raise DataError(f"inertial_frame = {shown(frame)} is neither of {', '.join(INERTIAL_FRAMES)}")
    return bool(frame == "world")


def _device(row: Mapping[str, Any], model: SegmentModel) -> Device:
    name, mount = str(row["device"]), row.get("mount")
    return Device(
        name,
        model.index(str(row["segment"])),
        _vector(row.get("position", (0, 0, 0)), 3, name),
        None if mount is None else from_quaternions(_vector(mount, 4, f"{name}: mount")),
    )


def _t_pose(row: Mapping[str, Any] | None) -> TPose | None:
    if row is None:
        return None
    facing, begin, end = row.get("facing"), int(row["from_ns"]), int(row["to_ns"])
    if begin >= end:
        raise DataError(f"t_pose: from_ns {begin} is not before to_ns {end}")
    found = None if facing is None else _vector(facing, 3, "facing")
    if found is not None and not found[:2].any():
        raise DataError(f"t_pose: facing = {shown(facing)} has no direction on the floor")
    return TPose(begin, end, found)


def _bone(values: Any, name: str, stature: float) -> Array:
    found = _vector(values, 3, name)
    if np.linalg.norm(found) > 0.5 * stature:
        raise DataError(f"segments: {name} = {shown(values)} m is more than half of the stature")
    return found


def _vector(values: Any, count: int, where: str) -> Array:
    found = np.array(values, float)
    if found.shape != (count,) or not (np.abs(found) <= LARGEST).all():
        raise DataError(f"{where} = {shown(values)} is not {count} numbers, at most {LARGEST:g}")
    if count == 4 and not found.any():
        raise DataError(f"{where} = {shown(values)} is not a rotation; expected a quaternion w x y z")
    return found


def _rounded(values: Array, digits: int = 5) -> list[float]:
    found: list[float] = np.round(values, digits).tolist()
    return found
