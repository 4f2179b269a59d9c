"""timestamps.csv of a capture folder: the stamp of every frame of every camera."""
from __future__ import annotations

import csv
from collections.abc import Collection
from pathlib import Path

from panoptic_ros.errors import DataError
from panoptic_ros.io.files import file_errors

COLUMNS = ("camera", "frame", "stamp_ns")


def read_timestamps(path: Path, sounds: Collection[str] = ()) -> dict[str, tuple[int, ...]]:
    """Stamps in ns of frames 0, 1, 2, ... by camera. The rows may come in any order.

    Args:
        sounds: devices whose rows are left out: they are of samples.

    Raises:
        DataError: naming the line that has no three columns, no numbers, or a frame twice; or the
            camera that lacks a frame.
    """
    stamps = {name: frames for name, frames in _read(path).items() if name not in sounds}
    return {camera: _in_order(frames, f"{path}: camera {camera}") for camera, frames in stamps.items()}


def read_sound_stamps(path: Path, sounds: Collection[str]) -> dict[str, list[tuple[int, int]]]:
    """Rows (index of a sample, stamp in ns) of devices that recorded sound, in order; {} without a file.

    Raises:
        DataError: see `read_timestamps`.
    """
    stamps = _read(path) if sounds and path.exists() else {}
    return {name: sorted(rows.items()) for name, rows in stamps.items() if name in sounds}


def _read(path: Path) -> dict[str, dict[int, int]]:
    """Stamps by name and frame."""
    stamps: dict[str, dict[int, int]] = {}
    with file_errors(path, "read"), open(path, encoding="utf-8-sig", newline="") as file:
        try:
            reader = csv.reader(file)
            header = tuple(word.strip() for word in next(reader, []))
            if header != COLUMNS:
                raise DataError(f"{path} line 1: columns {', '.join(COLUMNS)} expected, found {header}")
            for row in reader:
                if row:
                    _add(stamps, row, f"{path} line {reader.line_num}")
        except (UnicodeDecodeError, csv.Error) as error:
            raise DataError(f"{path} is not readable as CSV: {error}") from None
    return stamps


def _add(stamps: dict[str, dict[int, int]], row: list[str], where: str) -> None:
    try:
        camera, frame, stamp = row[0].strip(), int(row[1]), int(row[2])
    except (IndexError, ValueError):
        raise DataError(f"{where}: expected camera,frame,stamp_ns with whole numbers, found {row}") from None
    if not 0 <= stamp < 2**63:
        raise DataError(f"{where}: stamp_ns {stamp} is out of range")
    frames = stamps.setdefault(camera, {})
    if frame in frames:
        raise DataError(f"{where}: frame {frame} of camera {camera} a second time")
    frames[frame] = stamp


def _in_order(frames: dict[int, int], what: str) -> tuple[int, ...]:
    for frame in range(len(frames)):
        if frame not in frames:
            raise DataError(f"{what}: frame {frame} has no stamp, though there are {len(frames)} rows")
    return tuple(frames[frame] for frame in range(len(frames)))
