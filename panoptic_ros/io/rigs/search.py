"""The rig of a capture folder."""

from __future__ import annotations

from pathlib import Path

from panoptic_ros.errors import CalibrationError, DataError, UsageError, UserError
from panoptic_ros.io.loading import parsing
from panoptic_ros.io.rigs.document import load_document
from panoptic_ros.io.rigs.foreign import REMEDY, foreign_format
from panoptic_ros.io.rigs.registry import is_rig

SUFFIXES = (".json", ".json.gz", ".toml", ".qca.txt", ".xml", ".cal")
FOREIGN = (".yml", ".yaml", ".txt", ".xcp")  # of calibrations that are not read
FOLDERS = ("calib",)  # beginnings of their names, without case


def find_rig(folder: Path) -> Path:
    """rig.json if there is one, else the only file (or camera_info folder) that is a rig.

    Looks in the folder itself and in folders like `calibration/`.

    Raises:
        DataError: if there is none.
        UsageError: if there are several and none is called rig.json.
    """
    if not folder.is_dir():
        raise DataError(f"{folder} is no folder")
    if (folder / "rig.json").is_file():
        return folder / "rig.json"
    inside = sorted(path for path in folder.iterdir() if path.is_dir())
    places = [folder, *(path for path in inside if path.name.casefold().startswith(FOLDERS))]
    found = [path for place in places for path in [place, *_files(place)] if _is_rig(path)]
    if not found:
        raise DataError(
            f"{folder} has no rig; put rig.json or another calibration file there, or name it with --rig"
            + "".join(_faults(places))
        )
    if len(found) > 1:
        names = ", ".join(str(path.relative_to(folder)) for path in found)
        raise UsageError(f"{folder} has several rigs: {names}; name the one to use, e.g. with --rig")
    return found[0]


def _files(place: Path, suffixes: tuple[str, ...] = SUFFIXES) -> list[Path]:
    return sorted(path for path in place.iterdir() if path.name.endswith(suffixes) and path.is_file())


def _faults(places: list[Path]) -> list[str]:
    """Describe the first file that is a broken rig, or one of another program; [] if there is none."""
    for path in (path for place in places for path in _files(place, (*SUFFIXES, *FOREIGN))):
        try:
            with parsing(path, CalibrationError):
                title = foreign_format(load_document(path))
        except UserError as error:
            return [f". {path.name}: {error}"]
        if title is not None:
            return [f". {path.name} is {title}, which is not read; {REMEDY}"]
    return []


def _is_rig(path: Path) -> bool:
    """Return whether a file is a rig; one that is broken is none here."""
    try:
        with parsing(path, CalibrationError):
            return is_rig(load_document(path))
    except UserError:
        return False
