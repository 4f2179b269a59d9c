"""Tables of frame stamps in CSV: this project's timestamps.csv, and that of caliscope recordings."""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from panoptic_ros.errors import DataError
from panoptic_ros.io.documents import csv_rows, decoded
from panoptic_ros.io.loading import read_unpacked

OWN = ("camera", "frame", "stamp_ns")
CALISCOPE = ({"cam_id", "frame_time"}, {"port", "frame_time"})  # s; frame_index where there is one


@dataclass
class StampTable:
    """Stamps of one camera in the order of its frames, and their numbers where the device counts them."""

    stamps_ns: list[int]
    numbers: list[int] | None = None


def read_stamps(path: Path) -> dict[str, StampTable]:
    """Stamps by camera.

    Raises:
        DataError: naming the file, and the line that is wrong.
    """
    lines = csv_rows(decoded(read_unpacked(path), path), path)
    header = next((row for _, row in lines if row), [])
    columns = [name.strip() for name in header]
    rows = [(line, dict(zip(columns, map(str.strip, row)))) for line, row in lines if row]
    if set(OWN) <= set(columns):
        return _tables(path, rows, "camera", "stamp_ns", "frame", own=True)
    for known in CALISCOPE:
        if known <= set(columns):
            camera = next(iter(known - {"frame_time"}))
            return _tables(path, rows, camera, "frame_time", "frame_index", own=False)
    found = ", ".join(sorted(columns))[:80] or "none"
    raise DataError(f"{path} has the columns {found}; expected {', '.join(OWN)}, or cam_id and frame_time")


def _tables(
    path: Path, rows: list[tuple[int, dict[str, str]]], camera: str, time: str, number: str, own: bool
) -> dict[str, StampTable]:
    found: dict[str, list[tuple[int, int]]] = {}
    for line, row in rows:
        try:
            stamp = int(row[time]) if own else round(float(row[time]) * 1e9)
            own_number = int(float(row[number])) if row.get(number) else -1
        except (ValueError, OverflowError, KeyError):
            raise DataError(f"{path} line {line}: {time} and {number} are expected to be numbers") from None
        if not -(2**63) <= stamp < 2**63 or camera not in row:
            raise DataError(f"{path} line {line}: {time} is out of range, or {camera} is missing")
        found.setdefault(row[camera], []).append((own_number, stamp))
    tables = {}
    for name, entries in sorted(found.items()):
        numbered = all(n >= 0 for n, _ in entries)
        entries.sort(key=lambda entry: entry[0] if numbered else entry[1])
        numbers = [n for n, _ in entries] if numbered and not own else None
        tables[name] = StampTable([stamp for _, stamp in entries], numbers)
    return tables
