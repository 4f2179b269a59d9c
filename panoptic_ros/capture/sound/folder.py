"""Find the audio of a capture folder: `<device>.wav`, sound tracks of videos, and sound.yaml."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from panoptic_ros.capture.sound.described import described_sound
from panoptic_ros.errors import DataError, nearest, shown
from panoptic_ros.io.documents import read_yaml
from panoptic_ros.io.stamps import read_stamps, stamp_file

SOUND_NAMES = "sound.yaml"
SUFFIX = ".wav"


def folder_sounds(
    path: Path, cameras: Mapping[str, int], tracks: Mapping[str, Mapping[str, Any]]
) -> tuple[dict[str, Any], ...]:
    """Return descriptions of the audio in a capture folder (see `open_sound`), those of sound.yaml first.

    The file sound.yaml names the clock of each channel of a recording, {"timecode.wav": [A, B]}, "" for none.
    The long form is {"clocks": [A, B], "start_ns": timestamp of the first sample}. For a video with several
    sound tracks it is {"clocks": [A], "track": 1}. Rows of a device in timestamps.csv are timestamps of its
    samples. Without a stated start, a recording begins at 0, and that of a camera begins with its first
    frame.

    If sound.yaml exists, only the sound tracks that it names are used; otherwise all are. A WAV file of a
    camera replaces its sound track.

    Args:
        cameras: timestamp of the first frame by name.
        tracks: sound tracks of videos, as `track_sound` describes them, by file name.

    Raises:
        DataError: if sound.yaml has another structure, or names a missing file.
    """
    files = {file.name: file for file in sound_files(path)}
    says = (path / SOUND_NAMES).exists()
    named = _read_names(path / SOUND_NAMES) if says else {}
    for name in named:
        if name not in files and name not in tracks:
            there = ", ".join([*files, *tracks]) or "no WAV file and no video with sound"
            raise DataError(f"{path / SOUND_NAMES} names {name}; {path} has {there}")
    others = [file.stem for file in files.values() if file.stem not in cameras]
    table = stamp_file(path) if others else None
    tables = {} if table is None else read_stamps(table)
    stamps = {
        name: list(zip(own.frames or (), own.stamps_ns)) for name, own in tables.items() if name in others
    }
    found: dict[str, dict[str, Any]] = {}
    for name in dict.fromkeys([*named, *files, *(() if says else tracks)]):
        said = named.get(name, {})
        sound = (
            _described(files[name], said, stamps, cameras)
            if name in files
            else {"track": 0, **tracks[name], "clocks": [], **said}
        )
        device = sound["device"]
        if name in files and "track" in said:
            raise DataError(f"{path / SOUND_NAMES}: {name}: a WAV file has no tracks")
        if name in tracks and "start_ns" in said:
            raise DataError(f"{path / SOUND_NAMES}: {name}: the sound of a video begins where the video does")
        if device in found and name in named:
            raise DataError(f"{path / SOUND_NAMES} names two recordings of {device}; remove {name}")
        found.setdefault(device, sound)
    return tuple(found.values())


def track_sound(
    path: Path,
    device: str,
    start_ns: int,
    stamps: Sequence[int] = (),
    clocks: Sequence[str] = (),
    track: int = 0,
) -> dict[str, Any]:
    """Describe a sound track of a video; see `VideoSound` for the arguments."""
    own: dict[str, Any] = {"stamps": list(stamps)} if len(stamps) else {"start_ns": start_ns}
    own |= {"track": track} if track else {}
    return described_sound("video", device, clocks, path=str(path), **own)


def sound_files(path: Path) -> list[Path]:
    """Return the WAV files in a folder."""
    return [file for file in sorted(path.iterdir()) if file.suffix.lower() == SUFFIX]


def _described(
    file: Path,
    said: Mapping[str, Any],
    stamps: Mapping[str, Sequence[tuple[int, int]]],
    cameras: Mapping[str, int],
) -> dict[str, Any]:
    own, device = stamps.get(file.stem), file.stem
    begin = said.get("start_ns", cameras.get(device, 0))
    more = {"stamps": [list(row) for row in own]} if own else {"start_ns": begin}
    return described_sound("wav", device, said.get("clocks", ()), path=str(file), **more)


def _read_names(path: Path) -> dict[str, dict[str, Any]]:
    """Read sound.yaml as {file: {"clocks": names, "start_ns": timestamp, "track": number}}."""
    document = read_yaml(path)
    document = {} if document is None else document
    if not isinstance(document, dict):
        raise DataError(f"{path} must hold the clocks of files, e.g. timecode.wav: [A, B]")
    return {str(name): _entry(path, str(name), said) for name, said in document.items()}


KEYS = ("clocks", "start_ns", "track")


def _entry(path: Path, name: str, said: Any) -> dict[str, Any]:
    entry = said if isinstance(said, dict) else {"clocks": said}
    for key in entry:
        if key not in KEYS:
            raise DataError(f"{path}: {name} has an unknown key {shown(key)}; {nearest(key, KEYS)}")
    clocks = entry.get("clocks", [])
    clocks = clocks if isinstance(clocks, list) else [clocks]
    own = {key: entry[key] for key in ("start_ns", "track") if key in entry}
    plain = all(clock is None or isinstance(clock, (str, int)) for clock in clocks)
    counted = all(isinstance(number, int) and 0 <= number < 2**63 for number in own.values())
    if not plain or not counted:
        raise DataError(
            f"{path}: {name}: {shown(said)} is not a list of clocks, e.g. [A, B], and not of the form "
            "{clocks: [A, B], start_ns: 0}, or {clocks: [A], track: 1} of a video"
        )
    return {"clocks": ["" if clock is None else str(clock) for clock in clocks], **own}
