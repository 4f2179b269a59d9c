"""Find the images of each camera in a capture folder, and match file names to cameras of the rig."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from glob import escape
from pathlib import Path

from panoptic_ros.capture.depth_folder import SUFFIX as DEPTH_SUFFIX
from panoptic_ros.capture.image_folder import image_files
from panoptic_ros.domain import Rig
from panoptic_ros.errors import CalibrationError, DataError

# containers, and raw streams, which need a frame rate
VIDEO_SUFFIXES = (
    ".mp4",
    ".avi",
    ".mkv",
    ".mov",
    ".m4v",
    ".webm",
    ".mpg",
    ".mpeg",
    ".ts",
    ".mts",
    ".m2ts",
    ".m2t",
    ".mxf",
    ".wmv",
    ".asf",
    ".flv",
    ".3gp",
    ".3g2",
    ".ogv",
    ".vob",
    ".dv",
    ".h264",
    ".264",
    ".h265",
    ".265",
    ".hevc",
    ".mjpeg",
    ".mjpg",
)
# folders of videos or images in the layouts of other programs, in order of preference
PLACES = (
    "videos",
    "video",
    "hdvideos",
    "vgavideos",
    "kinectvideos",
    "synchronized_videos",
    "images",
    "imgs",
    "hdimgs",
    "vgaimgs",
    "kinectimgs",
)
# types of CMU's cameras, and prefixes of its folder names
KINDS = ("hd", "vga", "kinect")
MOST_OFFERED = 6  # names listed in a message


@dataclass(frozen=True)
class Media:
    """Files and folders of images of a rig.

    Args:
        files: path by camera of the rig.
        others: videos without a camera, by name.
        rig: the rig without camera types that have no folder.
        notices: lines.
    """

    files: Mapping[str, Path]
    others: Mapping[str, Path]
    rig: Rig
    notices: tuple[str, ...] = ()


def find_media(path: Path, rig: Rig) -> Media:
    """Find the video or image folder of each camera, in a folder or in its subfolders.

    Raises:
        DataError: if a camera has two.
    """
    here = _CameraFiles.of(path, rig)
    folders = [] if here.files else [folder for folder in sorted(path.iterdir()) if _may_hold(folder)]
    inside = [_CameraFiles.of(folder, rig) for folder in folders]
    inside = sorted((place for place in inside if place.files), key=lambda place: _rank(place.path))
    if here.files or not inside:
        return Media(here.files, here.others, rig, here.notices)
    files: dict[str, Path] = {}
    others: dict[str, Path] = {}
    used = []
    for place in inside:
        twice = sorted(set(files) & set(place.files))
        if twice and _rank(files[twice[0]].parent) == len(PLACES):
            raise DataError(
                f"camera {twice[0]} has both {files[twice[0]]} and {place.files[twice[0]]}; give the folder "
                "that is meant, with --rig"
            )
        if not twice:
            files |= place.files
            others |= place.others
            used.append(place)
    told = [f"images are taken from {', '.join(str(place.path) for place in used)}"] if used else []
    fitting, left_out = _of_kinds(rig, [place.path.name for place in used], files)
    named = [line for place in used for line in place.notices]
    return Media(files, others, fitting, (*told, *left_out, *named))


def has_media(path: Path) -> bool:
    """Return whether a folder or one of its `places_in` has a video or a folder of images."""
    return any(videos_in(place) or _image_folders(place) for place in places_in(path))


def cameras_of(path: Path) -> dict[str, Path]:
    """Return the video or folder of images of each camera of a folder without a rig, by file names.

    The first of its `places_in` with images counts.

    Raises:
        DataError: if the folder does not exist or holds no images, or a camera has two files.
    """
    if not path.is_dir():
        raise DataError(f"folder {path} " + ("is a file" if path.exists() else "does not exist"))
    for place in places_in(path):
        videos, folders = videos_in(place), _image_folders(place)
        for name in videos.keys() & folders.keys():
            raise DataError(f"camera {name} has both {videos[name]} and {folders[name]}; remove one")
        if videos or folders:
            return videos | folders
    raise DataError(f"{path} has no videos and no folders of images; give one per camera")


def places_in(path: Path) -> list[Path]:
    """Return a folder and its subfolders named as in `PLACES`; [] if the folder does not exist."""
    if not path.is_dir():
        return []
    known = (folder for folder in sorted(path.iterdir()) if _rank(folder) < len(PLACES))
    return [path, *filter(_may_hold, known)]


def videos_in(path: Path) -> dict[str, Path]:
    """Return the videos directly in a folder, by their names without suffix.

    Raises:
        DataError: if two names differ only in the suffix.
    """
    found: dict[str, Path] = {}
    for file in sorted(path.iterdir()):
        if file.is_file() and file.suffix.lower() in VIDEO_SUFFIXES and not file.name.startswith("."):
            if file.stem in found:
                first = found[file.stem]
                raise DataError(f"two videos of camera {file.stem}: {first} and {file}; remove one")
            found[file.stem] = file
    return found


def check_cameras(path: Path, media: Media, names: Sequence[str], every: bool) -> None:
    """Check that every video has a camera, or one that the rig leaves out, and every camera has images.

    Args:
        path: the capture folder.
        names: names of the cameras that are used.
        every: `names` are all cameras of the rig.

    Raises:
        CalibrationError: for videos without a camera.
        DataError: for cameras without images.
    """
    others = {name: file for name, file in media.others.items() if name not in media.rig.left_out}
    if others and every:
        lacking = [name for name in names if name not in media.files]
        raise CalibrationError(
            f"{path}: the rig has no camera for the videos {', '.join(others)}; it has "
            f"{', '.join(names)}"
            + (f"; cameras without a video: {', '.join(lacking)}" if lacking else "")
            + f"; {_offer(others, lacking)}"
        )
    for name in names:
        if name not in media.files:
            there = ",".join(other for other in names if other in media.files)
            raise DataError(
                f"{path} has no video {name}.mp4 and no images {name}/ for camera {name} of the rig; "
                "add them or choose available cameras"
                + (f" (--cameras {there})" if there else "")
                + _deeper(path, name)
            )


def _deeper(path: Path, name: str) -> str:
    """Return a hint at deeper folders with the video, as in caliscope's projects; "" if there are none."""
    files = [file for deep in ("*/*/", "*/*/*/") for file in path.glob(f"{deep}{escape(name)}.*")]
    places = sorted({str(file.parent) for file in files if file.suffix.lower() in VIDEO_SUFFIXES})
    if not places:
        return ""
    return f". {', '.join(places[:MOST_OFFERED])} has one: give that folder, and the rig with --rig"


def named_as(rig: Collection[str], names: Collection[str]) -> dict[str, str]:
    """Return the camera of a rig for each name: the equal one, or the only one that matches.

    Two names match if the words and numbers of one are a part of the other (cam01, int_cam01_img). They also
    match if numbers alone pair all names (port_0, port_1 and cam_0, cam_1).
    """
    found = {name: name for name in names if name in rig}
    free = [camera for camera in rig if camera not in found]
    left = [name for name in names if name not in found]
    fits = {name: [camera for camera in free if _fits(name, camera)] for name in left}
    for name, cameras in fits.items():
        if len(cameras) == 1 and sum(cameras[0] in others for others in fits.values()) == 1:
            found[name] = cameras[0]
    by_numbers = {_numbers(camera): camera for camera in free if _numbers(camera)}
    same = {name: by_numbers[_numbers(name)] for name in left if _numbers(name) in by_numbers}
    if not set(left) & set(found) and sorted(same.values()) == sorted(free):
        found |= same
    return found


@dataclass(frozen=True)
class _CameraFiles:
    """Files of a folder that belong to cameras of a rig."""

    path: Path
    files: Mapping[str, Path]
    others: Mapping[str, Path]
    notices: tuple[str, ...] = ()

    @staticmethod
    def of(path: Path, rig: Rig) -> _CameraFiles:
        videos, folders = videos_in(path), _image_folders(path)
        meant = named_as(rig.names, [name for name in videos if name not in rig.left_out])
        files = {camera: videos[name] for name, camera in meant.items()}
        for name, folder in folders.items():
            if name in files and name in rig.names:
                raise DataError(f"camera {name} has both {files[name]} and {folder}; remove one")
        folders = {name: folder for name, folder in folders.items() if name not in rig.left_out}
        lacking = [name for name in rig.names if name not in files]
        shorter = [n for n in folders if n in lacking or any(_is_part(_words(n), _words(c)) for c in lacking)]
        inside = named_as(lacking, shorter)
        files |= {camera: folders[name] for name, camera in inside.items()}
        other = {name: camera for name, camera in (meant | inside).items() if name != camera}
        taken = [f"{files[camera].name} as {camera}" for camera in other.values()]
        told = [f"files are taken as the only camera that fits: {', '.join(taken)}"] if taken else []
        others = {name: file for name, file in videos.items() if name not in meant}
        return _CameraFiles(path, files, others, tuple(told))


def _may_hold(folder: Path) -> bool:
    hidden = folder.name.startswith(".") or folder.name.endswith(DEPTH_SUFFIX)
    return folder.is_dir() and not hidden


def _rank(folder: Path) -> int:
    name = folder.name.casefold()
    return PLACES.index(name) if name in PLACES else len(PLACES)


def _image_folders(path: Path) -> dict[str, Path]:
    return {p.name: p for p in sorted(path.iterdir()) if _may_hold(p) and image_files(p)}


def _of_kinds(rig: Rig, places: Sequence[str], files: Collection[str]) -> tuple[Rig, list[str]]:
    """Return the rig without camera types that have no folder, and a notice.

    This only applies if folders are named by camera types.
    """
    kinds = {kind for kind in KINDS for place in places if place.casefold().startswith(kind)}
    types = {c.name: next((kind for kind in KINDS if c.type.startswith(kind)), "") for c in rig.cameras}
    out = [name for name in rig.names if types[name] not in kinds and name not in files]
    if not kinds or not out or any(not types[name] for name in out):
        return rig, []
    told = ", ".join(sorted({types[name] for name in out}))
    left = [name for name in rig.names if name not in out]
    return rig.subset(left), [f"{len(out)} cameras of type {told} have no folder of their kind: left out"]


def _offer(others: Mapping[str, Path], lacking: Sequence[str]) -> str:
    """Return text with possible matches of names and cameras, for an error message."""
    pairs = [
        f"{file.name} may be {camera}"
        for name, file in others.items()
        for camera in lacking
        if _fits(name, camera) or (_numbers(name) and _numbers(name) == _numbers(camera))
    ]
    if not pairs:
        return "names must be equal"
    return f"{', '.join(pairs[:MOST_OFFERED])}: rename files, or give --video CAMERA=FILE with --rig"


def _fits(one: str, other: str) -> bool:
    shorter, longer = sorted((_words(one), _words(other)), key=len)
    return _is_part(shorter, longer)


def _is_part(shorter: Sequence[str | int], longer: Sequence[str | int]) -> bool:
    """Return whether a sequence of words is part of a longer one and includes a number."""
    size = len(shorter)
    told = any(isinstance(word, int) for word in shorter)
    return told and any(longer[k : k + size] == shorter for k in range(len(longer) - size + 1))


def _words(name: str) -> list[str | int]:
    """Return the lower-case words and the numbers in a name."""
    return [int(w) if w.isdecimal() else w for w in re.findall(r"\d+|[^\W\d_]+", name.casefold())]


def _numbers(name: str) -> tuple[int, ...]:
    return tuple(word for word in _words(name) if isinstance(word, int))
