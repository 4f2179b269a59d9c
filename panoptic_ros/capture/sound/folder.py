"""The sound of a capture folder: `<device>.wav`, and what sound.yaml says of its channels."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from panoptic_ros.capture.sound.described import described_sound
from panoptic_ros.capture.timestamps import read_sound_stamps
from panoptic_ros.errors import DataError
from panoptic_ros.io.files import read_yaml

FILE = "sound.yaml"
SUFFIX = ".wav"


def folder_sounds(path: Path, cameras: Mapping[str, int]) -> tuple[dict[str, Any], ...]:
    """Descriptions of the sound in a capture folder (see `open_sound`), those of sound.yaml first.

    sound.yaml names the clock of each channel of a file, {"timecode.wav": [A, B]}, "" where there is none;
    or {"clocks": [A, B], "start_ns": stamp of the first sample}. Rows of a device in timestamps.csv are
    stamps of its samples. Where nothing says when it began, it began at 0, and that of a camera with the
    first frame.

    Args:
        cameras: stamp of the first frame by name.

    Raises:
        DataError: if sound.yaml is of another form, or names what is not there.
    """
    files = {file.name: file for file in sound_files(path)}
    named = _read_names(path / FILE) if (path / FILE).exists() else {}
    for name in named:
        if name not in files:
            there = ", ".join(files) or "no WAV file"
            raise DataError(f"{path / FILE} names {name}; {path} has {there}")
    others = [file.stem for file in files.values() if file.stem not in cameras]
    stamps = read_sound_stamps(path / "timestamps.csv", others)
    order = [*named, *(name for name in files if name not in named)]
    return tuple(_described(files[name], named.get(name, {}), stamps, cameras) for name in order)


def sound_files(path: Path) -> list[Path]:
    """The files of sound in a folder."""
    return [file for file in sorted(path.iterdir()) if file.suffix.lower() == SUFFIX]


def _described(
    file: Path, said: Mapping[str, Any], stamps: Mapping[str, Sequence[tuple[int, int]]],
    cameras: Mapping[str, int],
) -> dict[str, Any]:  # fmt: skip
    own, device = stamps.get(file.stem), file.stem
    begin = said.get("start_ns", cameras.get(device, 0))
    more = {"stamps": [list(row) for row in own]} if own else {"start_ns": begin}
    return described_sound("wav", device, said.get("clocks", ()), path=str(file), **more)


def _read_names(path: Path) -> dict[str, dict[str, Any]]:
    """{file: {"clocks": names, "start_ns": stamp}}."""
    document = read_yaml(path) or {}
    if not isinstance(document, dict):
        raise DataError(f"{path} must hold the clocks of files, e.g. timecode.wav: [A, B]")
    return {str(name): _entry(path, str(name), said) for name, said in document.items()}


def _entry(path: Path, name: str, said: Any) -> dict[str, Any]:
    entry = said if isinstance(said, dict) else {"clocks": said}
    clocks = entry.get("clocks", [])
    clocks = clocks if isinstance(clocks, list) else [clocks]
    start = entry.get("start_ns", 0)
    plain = all(clock is None or isinstance(clock, (str, int)) for clock in clocks)
    if not plain or not isinstance(start, int) or start < 0 or entry.keys() - {"clocks", "start_ns"}:
        raise DataError(
            f"{path}: {name}: {said!r} is no list of clocks, e.g. [A, B], and not of the form "
            "{clocks: [A, B], start_ns: 0}"
        )
    own = {"start_ns": start} if "start_ns" in entry else {}
    return {"clocks": ["" if clock is None else str(clock) for clock in clocks], **own}
