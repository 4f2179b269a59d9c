"""Handles unclosed takes: live recordings that no process closed.

The next run lists them at its start. Their intact content can be saved to a new folder.
"""

from __future__ import annotations

import shutil
import warnings
from dataclasses import dataclass
from pathlib import Path

from panoptic_ros.errors import DataError
from panoptic_ros.io.files import write_json
from panoptic_ros.io.folders import whole_folder
from panoptic_ros.io.frame_stream import CutFileWarning, read_frames
from panoptic_ros.io.salvage import repair
from panoptic_ros.io.salvage.repair import RepairResult
from panoptic_ros.io.storages import is_storage
from panoptic_ros.io.takes import OPEN, is_recorded_now, mark_saved, unclosed_takes

MOST_NAMED = 3  # takes listed at the start of a run; `panoptic doctor` lists all
# frame files beside the bag of a run
FRAMES = ("skeletons.json.gz", "skeletons_at.json.gz", "kinematics.json.gz")


@dataclass(frozen=True)
class SavedTake:
    """Content that was saved from a take.

    Args:
        bags: Repaired bags by path relative to the new folder; "" = the folder itself.
        frames: Number of intact frames by name of the frame file.
        lost: One line about each loss.
    """

    bags: dict[str, RepairResult]
    frames: dict[str, int]
    lost: tuple[str, ...]


def named_unclosed_takes() -> list[str]:
    """Return one line for the user about each unclosed take of this user.

    At most `MOST_NAMED` takes are listed. One more line gives the number of the others.
    """
    takes = unclosed_takes()
    lines = [str(take) for take in takes[:MOST_NAMED]]
    if len(takes) > MOST_NAMED:
        lines.append(f"{len(takes) - MOST_NAMED} more takes were not closed; `panoptic doctor` names all")
    return lines


def save_take(source: Path, target: Path) -> SavedTake:
    """Write the intact content of a bag or a live take to a new folder. The old folder keeps its files.

    Args:
        source: a bag, one of its files, the folder of a run, or a recording in parts.
        target: the new folder. It must not exist.

    Raises:
        DataError: if nothing is intact, or the take is still being recorded.
    """
    if source.is_dir() and is_recorded_now(source):
        raise DataError(f"{source} is being recorded now; end that first")
    parts = [] if source.is_file() else sorted(path for path in _folders(source) if _has_bag(path))
    if not parts or _has_bag(source):
        saved = SavedTake({"": (made := repair(source, target))}, {}, made.lost)
        mark_saved(source)
        return saved
    bags: dict[str, RepairResult] = {}
    frames: dict[str, int] = {}
    lost: list[str] = []
    with whole_folder(target) as folder:
        for part in parts:
            try:
                bags[part.name] = repair(part, folder / part.name)
                lost += [f"{part.name}: {line}" for line in bags[part.name].lost]
            except DataError as error:  # the part had just begun and has no message yet
                lost.append(f"{part.name}: {error}")
        for name in FRAMES:
            if (source / name).is_file():
                frames[name] = _save_frames(source / name, folder / name, lost)
        if not bags and not any(frames.values()):
            raise DataError(f"{source} has no whole message and no whole frame: {'; '.join(lost)}")
        _copy_rest(source, folder, [*FRAMES, *(part.name for part in parts), OPEN])
    mark_saved(source)
    return SavedTake(bags, frames, tuple(lost))


def _save_frames(source: Path, target: Path, lost: list[str]) -> int:
    """Write the intact frames of a file; return their number.

    Args:
        lost: receives a line about each loss.
    """
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", CutFileWarning)
        try:
            document = read_frames(source)
            count = len(document["frames"])
        except (DataError, KeyError, TypeError) as error:
            lost.append(f"{source.name}: {error}")
            return 0
    lost += [f"{source.name}: {each.message}" for each in told if issubclass(each.category, CutFileWarning)]
    write_json(target, document)
    return count


def _copy_rest(source: Path, target: Path, known: list[str]) -> None:
    """Copy the small files of a take: rig, report, logs.

    Args:
        known: names of files and folders that are handled already.
    """
    for path in source.iterdir():
        if path.name in known or path.name.startswith("."):
            continue
        if path.is_dir():
            shutil.copytree(path, target / path.name)
        else:
            shutil.copy2(path, target / path.name)


def _folders(source: Path) -> list[Path]:
    return [path for path in source.iterdir() if path.is_dir()] if source.is_dir() else []


def _has_bag(folder: Path) -> bool:
    return folder.is_dir() and any(is_storage(path) for path in folder.iterdir())
