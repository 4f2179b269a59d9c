"""Estimates the clocks of cameras from recorded sound, in a capture folder or a bag."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.capture import find_media, folder_stamps, starts_of_files, videos_in
from panoptic_ros.capture.sound import folder_sounds, known_tracks, open_sound, track_sound
from panoptic_ros.domain import AudioBlock, Rig, StampLine
from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.io.bags import BagReader, is_bag
from panoptic_ros.io.rigs import find_rig, read_rig
from panoptic_ros.offsets.sound import SoundClockEstimate, SoundClocks, SoundClocksConfig
from panoptic_ros.offsets.sound.passes import APART
from panoptic_ros.running.plans.options import RunOptions
from panoptic_ros.running.sound.bags import recorder_of, sound_streams
from panoptic_ros.running.sound.use import SoundRecorder
from panoptic_ros.stage import Progress, untold
from panoptic_ros.view.clock_lines import sound_lines

Array = np.ndarray
SECOND = 1_000_000_000


class SoundRecording:
    """Sound of recorders as a `stage.Recording`. Each call reads it again from its source."""

    def __init__(self, recorders: Sequence[SoundRecorder]):
        self._blocks = {r.device: r.blocks for r in recorders if r.blocks is not None}

    def records(
        self, topic: str, scope: str = "", begin_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[AudioBlock]:
        """Yield audio blocks, see `stage.Recording`. The only topic is "audio"."""
        blocks: Callable[[], Iterator[AudioBlock]] | None = self._blocks.get(scope)
        for block in blocks() if topic == "audio" and blocks is not None else ():
            if (begin_ns is None or block.stamp_ns >= begin_ns) and (
                end_ns is None or block.stamp_ns < end_ns
            ):
                yield block


def clocks_from_sound(
    recorders: Sequence[SoundRecorder],
    cameras: Sequence[str],
    rig: Rig | None = None,
    *,
    trusted: str = "",
    apart: float = APART,
    progress: Progress = untold,
) -> SoundClockEstimate:
    """Return the clocks of cameras, estimated from sound.

    The sound of a camera comes from the device with its name, or from the device that the rig names as its
    clock.

    Args:
        rig: provides the positions of the cameras; None = unknown.
        trusted, apart: see `SoundClocksConfig`.

    Raises:
        UserError: if there is no sound of two devices, or it cannot be read.
    """
    devices = [recorder.device for recorder in recorders]
    clocks = {camera.name: camera.clock for camera in rig.cameras} if rig else {}
    heard = {
        name: name if name in devices else clocks.get(name, "") if clocks.get(name) in devices else ""
        for name in cameras
    }
    if len({device for device in heard.values() if device}) < 2:
        there = ", ".join(devices) or "none"
        raise DataError(
            f"clocks from sound need that of two of the cameras {', '.join(cameras)}; there is sound of "
            f"{there}"
        )
    places: dict[str, Array] = {}
    for camera in rig.cameras if rig else ():
        if heard.get(camera.name):
            places.setdefault(heard[camera.name], camera.centre)
    config = SoundClocksConfig(heard, places, apart, trusted)
    return SoundClocks(config).run(SoundRecording(recorders), progress)


def recorders_of(sounds: Sequence[Mapping[str, Any]]) -> list[SoundRecorder]:
    """Return the recorders that the descriptions for `open_sound` describe."""

    def reader(sound: Mapping[str, Any]) -> Callable[[], Iterator[AudioBlock]]:
        def blocks() -> Iterator[AudioBlock]:
            with open_sound(sound) as source:
                yield from source

        return blocks

    return [
        SoundRecorder(str(s["device"]), tuple(s["clocks"]), Path(s["path"]).name, reader(s)) for s in sounds
    ]


def recorded_sound(path: Path) -> tuple[list[SoundRecorder], Rig | None]:
    """Return the recorders of a capture folder or a bag, and the rig of a folder if there is one.

    In a folder, sound comes from WAV files and from the sound tracks of videos. Images are not needed.

    Raises:
        DataError: if there is no sound.
        UsageError: if `path` is neither a capture folder nor a bag, or contains several rigs.
    """
    if not path.exists():
        raise DataError(f"{path} does not exist")
    if is_bag(path):
        with ExitStack() as stack:
            streams = sound_streams([stack.enter_context(BagReader(path))])
        found = [recorder_of(stream) for stream in streams]
        rig = None
    elif path.is_dir():
        rig = _rig_of(path)
        media = None if rig is None else find_media(path, rig)
        files = videos_in(path) if media is None else {**media.others, **media.files}
        stamps, _ = folder_stamps(path, files, rig.names if rig is not None else list(files))
        starts = {} if stamps else starts_of_files(files)
        tracks = {
            file.name: sound
            for name, file in files.items()
            if file.is_file()
            for sound in [_track(file, name, starts.get(name, 0), stamps.get(name, ()))]
            if sound is not None
        }
        begins = starts | {name: own[0] for name, own in stamps.items() if own}
        found = recorders_of(folder_sounds(path, begins, tracks))
    else:
        raise UsageError(f"{path} is neither a capture folder nor a bag; sound is taken from these")
    if not found:
        raise DataError(f"{path} has no sound: no WAV file, no video with a sound track")
    return found, rig


def _track(path: Path, device: str, start_ns: int, stamps: Sequence[int]) -> dict[str, Any] | None:
    """Return the description of a video's first sound track; None if there is none."""
    try:
        sound = track_sound(path, device, start_ns, stamps, track=known_tracks(path)[0])
        with open_sound(sound):
            return sound
    except (DataError, IndexError):
        return None


def _rig_of(path: Path) -> Rig | None:
    try:
        return read_rig(find_rig(path))
    except DataError:
        return None


def corrections_from_sound(
    recorders: Sequence[SoundRecorder], rig: Rig, options: RunOptions
) -> tuple[dict[str, StampLine], tuple[str, ...]]:
    """Return the timestamp corrections of a run, by camera, and lines about the corrections.

    Only cameras whose clocks differ are corrected.

    Raises:
        UsageError: if the sound carries timecode, which is more accurate, or offsets are given as well.
        DataError: if no two cameras have sound, or the sound determines no clock.
    """
    named = [recorder.device for recorder in recorders if any(recorder.clocks)]
    if named:
        raise UsageError(
            f"the sound of {', '.join(named)} carries timecode, which gives better clocks; leave "
            "--offsets-from-sound out"
        )
    if options.offsets:
        raise UsageError("give --offsets FILE or --offsets-from-sound, which estimates them again, not both")
    found = clocks_from_sound(recorders, rig.names, rig, apart=options.apart)
    clocks = found.clocks
    if not clocks.known.any():
        why = next(iter(found.unknown.values()))
        raise DataError(f"sound gives the clock of no camera: {why}; leave --offsets-from-sound out")
    lines = {
        name: StampLine(
            int(clocks.reference_ns), round(SECOND * float(clocks.offsets[c])), float(clocks.drifts[c])
        )
        for c, name in enumerate(clocks.cameras)
        if clocks.applied[c]
    }
    return lines, tuple(line.strip() for line in sound_lines(found))


def folder_clocks(
    path: Path,
    rig: Path | None = None,
    *,
    trusted: str = "",
    apart: float = APART,
    progress: Progress = untold,
) -> SoundClockEstimate:
    """Return the clocks of the cameras of a capture folder or a bag, estimated from sound.

    The cameras are those of the rig, or all devices if there is no rig.

    Args:
        rig: calibration file that replaces the folder's own.
        trusted, apart: see `SoundClocksConfig`.

    Raises:
        UserError: if there is no sound of two devices, or it cannot be read.
    """
    recorders, own = recorded_sound(path)
    known = read_rig(rig) if rig is not None else own
    cameras = known.names if known is not None else [recorder.device for recorder in recorders]
    return clocks_from_sound(recorders, cameras, known, trusted=trusted, apart=apart, progress=progress)
