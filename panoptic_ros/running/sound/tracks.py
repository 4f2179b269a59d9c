"""Finds the sound tracks of videos that carry timecode, and the cameras that they put on their own clocks.

The frames of a video and its sound share one time line, the clock of that camera. Some frames have no
timestamps except their positions in the video. A timecode in the sound then gives their capture times.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from pathlib import Path
from typing import Any

from panoptic_ros.capture.sound import known_tracks, open_sound
from panoptic_ros.domain import AudioBlock, Rig, TimecodeReading
from panoptic_ros.errors import DataError
from panoptic_ros.params import Config, config_of
from panoptic_ros.timecode.config import TimecodeConfig
from panoptic_ros.timecode.stage import TimecodeStage

LISTEN_S = 5.0  # s of a track to decode if its content is not stated; timecode is recognised within 0.3 s
WORDS = 3  # timecode words that confirm a timecode
SAME_S = 0.002  # s, maximum difference between two channels with the same timecode
SECOND = 1_000_000_000
Sound = Mapping[str, Any]


@dataclass(frozen=True)
class CaptureSound:
    """Sound tracks of a capture.

    Args:
        rig: Rig in which cameras that are timestamped by their videos have their own clocks.
        sounds: The used sounds, with the clocks of their channels.
        notices: Lines for the user.
    """

    rig: Rig
    sounds: tuple[Sound, ...]
    notices: tuple[str, ...] = ()


def find_tracks(
    rig: Rig, sounds: Sequence[Sound], stamped: Collection[str], configs: Mapping[str, Config]
) -> CaptureSound:
    """Find the sound tracks with timecode, and put their cameras on their own clocks.

    A track that sound.yaml names is used as stated there. Other tracks are decoded for `LISTEN_S` from their
    beginning. This is done only if their camera has no timestamps except those of the video, or if the rig
    puts it on its own clock.

    Args:
        sounds: descriptions for `open_sound`.
        stamped: cameras whose frames have timestamps in addition to the times of their videos.

    Raises:
        DataError: if cameras without timestamps cannot be aligned with the others.
    """
    tracks = {str(sound["device"]): sound for sound in sounds if sound["kind"] == "video"}
    found, notices = dict(tracks), list[str]()
    clocks = {camera.name: camera.clock for camera in rig.cameras}
    unnamed = [name for name, sound in tracks.items() if not sound["clocks"]]
    asked = [name for name in unnamed if name not in stamped or clocks.get(name) == name]
    for name in unnamed:
        each = known_tracks(Path(tracks[name]["path"])) if name in asked else ()
        heard = ({**tracks[name], "track": k} for k in each)
        named = ({**one, "clocks": _timecode_of(one, configs, clocks.get(name) or name)} for one in heard)
        found[name] = next((one for one in named if one["clocks"]), tracks[name])
    silent = [name for name in unnamed if not found[name]["clocks"]]
    if silent:
        notices.append(_line(tracks, silent, asked))
    own = {
        name: name
        for name, sound in found.items()
        if name in clocks and (name in sound["clocks"] or (name not in stamped and any(sound["clocks"])))
    }
    kept = [found.get(str(s["device"]), s) if s["kind"] == "video" else s for s in sounds]
    kept = [sound for sound in kept if sound["kind"] != "video" or any(sound["clocks"])]
    _require_stamps(rig, kept, {*own, *stamped}, own)
    cameras = tuple(replace(camera, clock=own.get(camera.name, camera.clock)) for camera in rig.cameras)
    return CaptureSound(replace(rig, cameras=cameras), tuple(kept), tuple(notices))


def _timecode_of(sound: Sound, configs: Mapping[str, Config], clock: str) -> list[str]:
    """Return the clock of each channel of a sound track: `clock` for the channel with timecode, else "".

    The result is empty if no channel carries timecode.

    Raises:
        DataError: if two channels carry different timecodes.
    """
    with open_sound(sound) as source:
        blocks = list(takewhile(_within(), source))
    if not blocks:
        return []
    words: dict[int, list[TimecodeReading]] = {}
    channels = blocks[0].samples.shape[1]
    for channel in range(channels):
        if channel and all((b.samples[:, channel] == b.samples[:, 0]).all() for b in blocks):
            continue  # the same microphone on all channels
        stage = TimecodeStage(config_of(configs, TimecodeConfig))
        heard = [
            reading
            for block in blocks
            for reading in stage.step(replace(block, samples=block.samples[:, channel], clocks=())).outputs
        ]
        if len(heard) >= WORDS:
            words[channel] = heard
    if not words:
        return []
    first, *others = words.values()
    for other in others:
        if not _is_same(first, other):
            raise DataError(
                f"{Path(sound['path']).name} has two timecodes, {first[0].timecode} and "
                f"{other[0].timecode}, on channels {' and '.join(map(str, words))}: name their clocks in "
                f"sound.yaml, e.g. {Path(sound['path']).name}: [A, B]"
            )
    chosen = next(iter(words))
    return [clock if channel == chosen else "" for channel in range(channels)]


def _within() -> Any:
    """Return a predicate that accepts blocks within the first `LISTEN_S` of a track."""
    firsts: list[int] = []

    def inside(block: AudioBlock) -> bool:
        firsts.append(block.first_sample)
        return block.first_sample - firsts[0] < LISTEN_S * block.sample_rate

    return inside


def _is_same(one: Sequence[TimecodeReading], other: Sequence[TimecodeReading]) -> bool:
    """Return whether two channels carry the same timecode at the same times."""
    starts = {str(reading.timecode): reading.stamp_ns for reading in one}
    apart = [abs(r.stamp_ns - starts[str(r.timecode)]) for r in other if str(r.timecode) in starts]
    return bool(apart) and max(apart) < SAME_S * SECOND


def _line(tracks: Mapping[str, Sound], silent: Sequence[str], asked: Collection[str]) -> str:
    """Return a line about sound tracks without timecode."""
    files = ", ".join(Path(tracks[name]["path"]).name for name in silent)
    if not set(silent) & set(asked):
        return (
            f"the sound of {files} is not used: the frames have stamps; if it carries timecode, name "
            "its clock in sound.yaml"
        )
    return (
        f"no timecode in the first {LISTEN_S:.0f} s of the sound of {files}: their frames are numbered "
        "as in the videos; if timecode begins later, name its clock in sound.yaml"
    )


def _require_stamps(
    rig: Rig, sounds: Sequence[Sound], timed: Collection[str], own: Mapping[str, str]
) -> None:
    """Check that cameras without timestamps have timecode, if other cameras use timecode.

    The times of a video alone cannot be aligned with a timecode that its sound does not carry.

    Raises:
        DataError: if a camera has neither.
    """
    devices = [str(sound["device"]) for sound in sounds]
    named = {clock for sound in sounds for clock in sound["clocks"] if clock and clock not in devices}
    lost = [
        c.name
        for c in rig.cameras
        if c.name not in timed and c.clock not in devices and (own or c.clock in named)
    ]
    if lost:
        others = f"{', '.join(own)} have timecode" if own else "the rig states that timecode stamps them"
        raise DataError(
            f"{', '.join(lost)} have neither stamps nor timecode in their sound, but {others}: add "
            "timestamps.csv, name their sound tracks in sound.yaml, or leave them out (--cameras)"
        )
