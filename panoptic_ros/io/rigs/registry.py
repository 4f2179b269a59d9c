"""Registry of the rig formats: read by content, write by format name, find the rig of a capture folder."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.domain.upright import Z_UP
from panoptic_ros.errors import CalibrationError, DataError, UsageError, UserError
from panoptic_ros.io.files import check_output_folder, file_errors, write_bytes
from panoptic_ros.io.known_keys import EACH, OTHERS, Keys, keys, tell_unknown
from panoptic_ros.io.loading import parsing
from panoptic_ros.io.rigs import (
    camera_info,
    camera_lists,
    qualisys,
    rig_json,
    toml_rigs,
    total_capture,
)
from panoptic_ros.io.rigs.document import Document, load_document
from panoptic_ros.io.rigs.foreign import REMEDY, foreign_format
from panoptic_ros.io.rigs.options import ReadOptions


@dataclass(frozen=True)
class _Format:
    """One rig format.

    Args:
        name: As in `write_rig(format=...)`.
        title: Name in messages.
        syntax: Syntax of `Document`.
        recognises: Returns whether parsed content is of this format.
        parse: Converts content and options to a rig.
        dump: Converts a rig to text, or to texts by file name; None = read only.
        uses: Options that the format supports.
        holds: Entries of `_EXTRAS` that the format can store.
        keys: Known keys, see `tell_unknown`; None for XML and numbers, and for folders, which check their
            own.
    """

    name: str
    title: str
    syntax: str
    recognises: Callable[[Any], bool]
    parse: Callable[[Any, ReadOptions], Rig]
    dump: Callable[[Rig], str | dict[str, str]] | None
    uses: frozenset[str] = frozenset()
    holds: frozenset[str] = frozenset()
    keys: Keys | None = None


def _has_many(camera: Camera) -> bool:
    return camera.intrinsics.lens == "brown" and len(camera.intrinsics.distortion) > 5


# Known keys of the JSON and TOML formats; others cause a warning, see `known_keys`.
_CAMERA = "name image_size K distortion R t type panel clock lens line_delay_us covariance"
RIG_JSON = keys(
    "format units frame_id up",
    cameras=[keys(_CAMERA)],
    depth_sensors=[keys(f"{_CAMERA} colour_camera unit_m")],
)
PANOPTIC = keys("calibDataSource", cameras=[keys("name type panel node resolution lens K distCoef R t")])
_PACKED = "name id K R t distortion distCoef distortion_model resolution image_size width height type panel"
# these files have many origins
PACK = keys(f"format unit units to_z_up {OTHERS}", cameras=[keys(f"{_PACKED} {OTHERS}")])

_LENS = "size matrix distortions distortion_model rotation translation fisheye"
ANIPOSELIB = {
    "metadata": keys(f"adjusted error unit up {OTHERS}"),  # may hold any notes about the calibration
    EACH: keys(f"name {_LENS} extra_dist"),
}
_CALISCOPE = "cam_id port name rotation_count error exposure grid_count ignore verified_resolutions"
CALISCOPE = keys(OTHERS, cameras={EACH: keys(f"{_CALISCOPE} {_LENS}")})

# Features that not every format can store, and a test whether a rig has them.
_EXTRAS: dict[str, Callable[[Rig], bool]] = {
    "fisheyes": lambda rig: any(camera.intrinsics.lens == "fisheye" for camera in rig.cameras),
    "cameras with more than five terms of distortion": lambda rig: any(map(_has_many, rig.cameras)),
    "type": lambda rig: any(camera.type for camera in rig.cameras),
    "panel": lambda rig: any(camera.panel for camera in rig.cameras),
    "clock": lambda rig: any(camera.clock for camera in rig.cameras),
    "line_delay_us": lambda rig: any(camera.line_delay_us for camera in rig.cameras),
    "covariance": lambda rig: any(camera.covariance is not None for camera in rig.cameras),
    "depth_sensors": lambda rig: bool(rig.depth_sensors),
    "up": lambda rig: rig.up is not None and rig.up != Z_UP,
}
_LENSES = frozenset(list(_EXTRAS)[:2])  # features without which the rig would be wrong
_SELECTION = frozenset({"types", "panels"})
_FORMATS = (
    _Format(
        "rig.json",
        "rig.json (panoptic-rig-1)",
        "json",
        lambda document: document.get("format") == rig_json.FORMAT,
        rig_json.parse,
        rig_json.dump,
        _SELECTION,
        frozenset(_EXTRAS),
        RIG_JSON,
    ),
    _Format(
        "panoptic",
        "CMU Panoptic JSON",
        "json",
        camera_lists.is_panoptic,
        camera_lists.parse_panoptic,
        camera_lists.dump,
        _SELECTION,
        frozenset({"type", "panel"}),
        PANOPTIC,
    ),
    _Format(
        "pack",
        "calibration.json with a stated unit",
        "json",
        camera_lists.is_pack,
        camera_lists.parse_pack,
        None,
        _SELECTION,
        keys=PACK,
    ),
    _Format(
        "qca",
        "Qualisys .qca.txt",
        "xml",
        qualisys.recognises,
        qualisys.parse,
        qualisys.dump,
    ),
    _Format(
        "caliscope",
        "caliscope TOML",
        "toml",
        toml_rigs.is_caliscope,
        toml_rigs.parse_caliscope,
        toml_rigs.dump_caliscope,
        frozenset({"unit"}),
        _LENSES | {"up"},
        CALISCOPE,
    ),
    _Format(
        "aniposelib",
        "aniposelib TOML",
        "toml",
        toml_rigs.is_aniposelib,
        toml_rigs.parse_aniposelib,
        toml_rigs.dump_aniposelib,
        frozenset({"unit"}),
        _LENSES | {"up"},
        ANIPOSELIB,
    ),
    _Format(
        "total-capture",
        "calibration.cal of Total Capture",
        "numbers",
        total_capture.recognises,
        total_capture.parse,
        None,
    ),
    _Format(
        "camera_info",
        f"a folder of ROS camera_info YAML with {camera_info.POSES}",
        "folder",
        camera_info.recognises,
        camera_info.parse,
        camera_info.dump,
        holds=_LENSES,
    ),
)
WRITABLE = tuple(item.name for item in _FORMATS if item.dump)


def read_rig(
    path: Path | str,
    *,
    unit: str | None = None,
    types: Sequence[str] = (),
    panels: Sequence[int] = (),
    cameras: Sequence[str] | None = None,
) -> Rig:
    """Read a rig from a file or folder in any supported format, detected by content.

    Args:
        unit: m, cm or mm, for TOML files, which do not state theirs. None = metres, unless the cameras would
            then be too far apart.
        types, panels: select cameras, for formats that state them (rig.json; CMU Panoptic JSON: vga, hd,
            kinect-color; panels 0 to 20).
        cameras: select cameras by name; others are not parsed. None = all usable cameras; `Rig.left_out`
            names the others.

    Raises:
        DataError: if it cannot be read.
        CalibrationError: if the format is unknown or the content is invalid; names the file.
        UsageError: for options that the format does not support, or that leave no camera.
    """
    path = Path(path)
    options = ReadOptions(unit, tuple(types), tuple(panels), None if cameras is None else tuple(cameras))
    try:
        with parsing("the file", CalibrationError):
            document = load_document(path)
            chosen = _format_of(document)
            useless = options.given() - chosen.uses
            if useless:
                raise UsageError(f"{path}: {chosen.title} has no use for {', '.join(sorted(useless))}")
            if document is not None and chosen.keys is not None:
                tell_unknown(document.content, chosen.keys, path)
            return chosen.parse(document.content if document else None, options)
    except CalibrationError as error:
        raise CalibrationError(f"{path}: {error}") from None


def is_rig(document: Document | None) -> bool:
    """Return whether a format recognises the document."""
    return any(_recognised(item, document) for item in _FORMATS)


def _recognised(item: _Format, document: Document | None) -> bool:
    return document is not None and item.syntax == document.syntax and item.recognises(document.content)


def _format_of(document: Document | None) -> _Format:
    for item in _FORMATS:
        if _recognised(item, document):
            return item
    if (title := foreign_format(document)) is not None:
        raise CalibrationError(f"this is {title}, which is not read; {REMEDY}")
    titles = ", ".join(item.title for item in _FORMATS)
    raise CalibrationError(f"no rig in a format that is known here; these are read: {titles}")


def write_rig(path: Path | str, rig: Rig, format: str | None = None) -> tuple[str, ...]:
    """Write a rig completely or not at all.

    Args:
        format: one of `WRITABLE`. None = by the name: *.qca.txt is Qualisys, *.toml aniposelib, *.json
            rig.json, and a name without suffix is a folder of camera_info files.

    Returns:
        features of the rig that the format cannot store, e.g. "clock", "depth_sensors".

    Raises:
        UsageError: for an unknown format, or one that cannot store a lens of the rig.
        EnvironmentProblem: if it cannot be written, or the folder exists already and is not empty.
    """
    path = Path(path)
    name = format or _by_name(path)
    chosen = next((item for item in _FORMATS if item.name == name), None)
    if chosen is None or chosen.dump is None:
        raise UsageError(f"cannot write a rig as {name!r}; formats are {', '.join(WRITABLE)}")
    lost = tuple(key for key, stated in _EXTRAS.items() if key not in chosen.holds and stated(rig))
    for kind in sorted(_LENSES & set(lost)):
        name = next(camera.name for camera in rig.cameras if _EXTRAS[kind](Rig((camera,))))
        able = ", ".join(item.name for item in _FORMATS if kind in item.holds and item.dump)
        raise UsageError(f"{chosen.title} has no {kind}, and camera {name} is one; write it as {able}")
    content = chosen.dump(rig)
    if isinstance(content, str):
        write_bytes(path, content.encode())
    else:
        _write_folder(path, content)
    return lost


def _by_name(path: Path) -> str:
    if path.name.endswith(".qca.txt"):
        return "qca"
    known = {".json": "rig.json", ".toml": "aniposelib", "": "camera_info"}
    return known.get(path.suffix, path.suffix)


def _write_folder(path: Path, files: dict[str, str]) -> None:
    path = check_output_folder(path)
    temporary = path.with_name(f".{path.name[:100]}.{os.getpid()}.part")
    with file_errors(path, "write"):
        try:
            temporary.mkdir(parents=True)
            for name, text in files.items():
                (temporary / name).write_text(text)
            os.replace(temporary, path)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)


SUFFIXES = (".json", ".json.gz", ".toml", ".qca.txt", ".xml", ".cal")
FOREIGN = (".yml", ".yaml", ".txt", ".xcp")  # suffixes of calibrations that cannot be read
FOLDERS = ("calib",)  # prefixes of folder names, without case


def find_rig(folder: Path) -> Path:
    """Return rig.json if it exists, else the only file (or camera_info folder) that is a rig.

    The search includes the folder itself and subfolders such as `calibration/`.

    Raises:
        DataError: if there is none.
        UsageError: if there are several and none is called rig.json.
    """
    if not folder.is_dir():
        raise DataError(f"{folder} is not a folder")
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
    """Describe the first file that is a broken rig or one of another program; [] if there is none."""
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
    """Return whether a file is a rig; a broken file is none."""
    try:
        with parsing(path, CalibrationError):
            return is_rig(load_document(path))
    except UserError:
        return False
