"""Read CSV tables of frame timestamps: timestamps.csv of this project, and tables of caliscope.

caliscope writes `cam_id,frame_time` (older versions `port,frame_time`) in seconds, and sometimes
`frame_index`. Its camera names are numbers.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation, Overflow
from pathlib import Path

from panoptic_ros.errors import DataError, shown
from panoptic_ros.io.documents import csv_rows, decoded
from panoptic_ros.io.loading import read_unpacked

NAMES = ("timestamps.csv", "frame_timestamps.csv", "frame_time_history.csv")
OWN = ("camera", "frame", "stamp_ns")
FOREIGN = ("cam_id", "port")  # column with the camera name, in a table with frame_time
TIME, INDEX = "frame_time", "frame_index"
SECOND_NS = 1_000_000_000
LARGEST = 2**63  # limit of timestamps and indices, which are 64-bit integers

Rows = Iterator[tuple[int, dict[str, str]]]


@dataclass
class StampTable:
    """Timestamps of one camera in the order of its frames.

    Args:
        stamps_ns: ns.
        numbers: frame numbers, if the device counts its frames; gaps are lost frames.
        frames: frame indices in the file, or sample indices of an audio device; None = 0, 1, 2, ...
    """

    stamps_ns: list[int]
    numbers: list[int] | None = None
    frames: list[int] | None = None


def stamp_file(folder: Path) -> Path | None:
    """Return the timestamp table of a capture folder; the first of `NAMES` that exists, or None."""
    return next((folder / name for name in NAMES if (folder / name).is_file()), None)


def read_stamps(path: Path) -> dict[str, StampTable]:
    """Read timestamps by camera name of the table. The rows may have any order.

    Raises:
        DataError: naming the file and the line, on wrong columns, an invalid number, or a duplicate frame.
    """
    lines = csv_rows(decoded(read_unpacked(path), path), path)
    at, header = next(((line, row) for line, row in lines if row), (1, []))
    columns = [name.strip() for name in header]
    rows = ((line, dict(zip(columns, map(str.strip, row)))) for line, row in lines if row)
    foreign = next((name for name in FOREIGN if {name, TIME} <= set(columns)), "")
    if not foreign and not set(OWN) <= set(columns):
        raise DataError(
            f"{path} line {at}: columns {', '.join(OWN)} expected, or cam_id and frame_time; found "
            f"{shown(header)}"
        )
    return _read_foreign(path, rows, foreign) if foreign else _read_own(path, rows)


def stamps_of_frames(path: Path, tables: dict[str, StampTable]) -> dict[str, tuple[int, ...]]:
    """Return the timestamps (ns) of frames 0, 1, 2, ... by camera.

    Raises:
        DataError: naming the camera and the frame without a timestamp.
    """
    for camera, table in tables.items():
        for frame, found in enumerate(table.frames or ()):
            if found != frame:
                raise DataError(
                    f"{path}: camera {camera[:60]}: frame {frame} has no stamp, though there are "
                    f"{len(table.stamps_ns)} rows"
                )
    return {camera: tuple(table.stamps_ns) for camera, table in tables.items()}


def _read_own(path: Path, rows: Rows) -> dict[str, StampTable]:
    found: dict[str, dict[int, int]] = {}
    for line, row in rows:
        where = f"{path} line {line}"
        try:
            camera, frame, stamp = row["camera"], int(row["frame"]), int(row["stamp_ns"])
        except (KeyError, ValueError):
            wanted = "camera,frame,stamp_ns with whole numbers"
            raise DataError(f"{where}: expected {wanted}, found {shown(list(row.values()))}") from None
        if not 0 <= stamp < LARGEST:
            raise DataError(f"{where}: stamp_ns {shown(stamp)} is out of range")
        twice = f"{where}: frame {shown(frame)} of camera {camera[:60]}"
        _add(found.setdefault(camera, {}), frame, stamp, twice)
    return {
        camera: StampTable([stamp for _, stamp in entries], None, [frame for frame, _ in entries])
        for camera, entries in ((name, sorted(own.items())) for name, own in found.items())
    }


def _read_foreign(path: Path, rows: Rows, camera: str) -> dict[str, StampTable]:
    found: dict[str, dict[int, int]] = {}
    times: dict[str, list[int]] = {}
    for line, row in rows:
        where = f"{path} line {line}"
        if not row.get(camera):
            raise DataError(f"{where}: {camera} is missing")
        if not row.get(TIME):  # a lost frame
            continue
        stamp = _number(row[TIME], SECOND_NS, f"{where}: {TIME}")
        times.setdefault(row[camera], []).append(stamp)
        if row.get(INDEX):
            frame = _number(row[INDEX], 1, f"{where}: {INDEX}")
            twice = f"{where}: {INDEX} {frame} of {camera} {row[camera][:60]}"
            _add(found.setdefault(row[camera], {}), frame, stamp, twice)
    tables = {}
    for name, own in sorted(times.items()):
        entries = sorted(found.get(name, {}).items())
        if len(entries) < len(own):  # not all rows have an index
            tables[name] = StampTable(sorted(own))
        else:
            numbers = [number for number, _ in entries]
            tables[name] = StampTable([stamp for _, stamp in entries], numbers, numbers)
    return tables


def _add(frames: dict[int, int], frame: int, stamp: int, what: str) -> None:
    if frame in frames:
        raise DataError(f"{what} a second time")
    frames[frame] = stamp


def _number(text: str, unit: int, what: str) -> int:
    """Return a decimal text times `unit`, rounded to an integer. A float would lose digits."""
    try:
        value = Decimal(text) * unit
        if 0 <= value < LARGEST:
            return int(value.to_integral_value())
    except InvalidOperation:
        raise DataError(f"{what} is {shown(text)}, expected a number") from None
    except Overflow:
        pass
    raise DataError(f"{what} is {shown(text)}, which is out of range")
