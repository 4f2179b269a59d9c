"""timestamps.csv of a capture folder: the stamp of every frame of every camera."""
from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from panoptic_ros.errors import DataError, shown
from panoptic_ros.io.documents import csv_rows, decoded
from panoptic_ros.io.loading import read_unpacked

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
    return {camera: _in_order(frames, f"{path}: camera {camera[:60]}") for camera, frames in stamps.items()}


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
    rows = csv_rows(decoded(read_unpacked(path), path), path)
    _, header = next(rows, (1, []))
    if tuple(word.strip() for word in header) != COLUMNS:
        raise DataError(f"{path} line 1: columns {', '.join(COLUMNS)} expected, found {shown(header)}")
    for line, row in rows:
        if row:
            _add(stamps, row, f"{path} line {line}")
    return stamps


def _add(stamps: dict[str, dict[int, int]], row: list[str], where: str) -> None:
    try:
        camera, frame, stamp = row[0].strip(), int(row[1]), int(row[2])
    except (IndexError, ValueError):
        wanted = "camera,frame,stamp_ns with whole numbers"
        raise DataError(f"{where}: expected {wanted}, found {shown(row)}") from None
    if not 0 <= stamp < 2**63:
        raise DataError(f"{where}: stamp_ns {shown(stamp)} is out of range")
    frames = stamps.setdefault(camera, {})
    if frame in frames:
        raise DataError(f"{where}: frame {shown(frame)} of camera {camera[:60]} a second time")
    frames[frame] = stamp


def _in_order(frames: dict[int, int], what: str) -> tuple[int, ...]:
    for frame in range(len(frames)):
        if frame not in frames:
            raise DataError(f"{what}: frame {frame} has no stamp, though there are {len(frames)} rows")
    return tuple(frames[frame] for frame in range(len(frames)))
