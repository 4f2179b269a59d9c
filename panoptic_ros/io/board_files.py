"""Read descriptions of calibration boards: YAML targets of Kalibr, charuco.toml of caliscope."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from panoptic_ros.calibration.boards import APRIL_DICTIONARY, UNITS, Board
from panoptic_ros.errors import DataError, UsageError, shown
from panoptic_ros.io.documents import parse_toml, read_text, read_yaml
from panoptic_ros.io.known_keys import keys, tell_unknown
from panoptic_ros.io.loading import parsing

KALIBR = keys(
    "target_type tagCols tagRows tagSize tagSpacing codeOffset targetCols targetRows rowSpacingMeters "
    "colSpacingMeters"
)
CALISCOPE = keys(
    "columns rows board_height board_width dictionary units aruco_scale square_size_override_cm inverted "
    "legacy_pattern"
)
SHORT_UNITS = {"inch": "in", "inches": "in"}


def read_board(path: Path) -> Board:
    """Return the board of a file: YAML as for Kalibr, TOML as of caliscope.

    Raises:
        DataError: naming the file and what is missing or wrong.
    """
    toml = path.suffix.lower() == ".toml"
    document = parse_toml(read_text(path), path) if toml else read_yaml(path)
    if not isinstance(document, Mapping):
        raise DataError(
            f"{path} describes no board; give a YAML target of Kalibr or caliscope's charuco.toml"
        )
    tell_unknown(document, CALISCOPE if toml else KALIBR, path)
    with parsing(path):
        try:
            return _caliscope(document, path) if toml else _kalibr(document, path)
        except UsageError as error:
            raise DataError(f"{path}: {error}") from None


def _kalibr(document: Mapping[str, Any], path: Path) -> Board:
    kind = document.get("target_type")
    if kind == "aprilgrid":
        columns, rows, size, ratio = _numbers(document, path, "tagCols", "tagRows", "tagSize", "tagSpacing")
        return Board("aprilgrid", int(columns), int(rows), size, ratio * size, APRIL_DICTIONARY)
    if kind == "checkerboard":
        columns, rows, along, across = _numbers(
            document, path, "targetCols", "targetRows", "colSpacingMeters", "rowSpacingMeters"
        )
        if along != across:
            raise DataError(
                f"{path}: squares of {along:g} x {across:g} m; colSpacingMeters and rowSpacingMeters must be "
                "equal"
            )
        return Board("checkerboard", int(columns), int(rows), along)
    raise DataError(f"{path}: target_type = {shown(kind)}; boards are aprilgrid and checkerboard")


def _caliscope(document: Mapping[str, Any], path: Path) -> Board:
    columns, rows = _numbers(document, path, "columns", "rows")
    if "square_size_override_cm" in document:
        size = _numbers(document, path, "square_size_override_cm")[0] * UNITS["cm"]
    else:
        unit = str(document.get("units", "cm"))
        unit = SHORT_UNITS.get(unit, unit)
        if unit not in UNITS:
            raise DataError(f"{path}: units = {shown(unit)}; units are {', '.join(UNITS)}")
        height, width = _numbers(document, path, "board_height", "board_width")
        size = min(height / rows, width / columns) * UNITS[unit]
    scale = _numbers(document, path, "aruco_scale")[0] if "aruco_scale" in document else 0.75
    return Board(
        "charuco",
        int(columns),
        int(rows),
        size,
        scale * size,
        str(document.get("dictionary", "")),
        bool(document.get("legacy_pattern", False)),
    )


def _numbers(document: Mapping[str, Any], path: Path, *names: str) -> list[float]:
    """Return the positive numbers of these names.

    Raises:
        DataError: if one is missing, or not a positive number.
    """
    found = []
    for name in names:
        value = document.get(name)
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < float("inf"):
            raise DataError(f"{path}: {name} = {shown(value)}; a positive number is expected")
        found.append(float(value))
    return found
