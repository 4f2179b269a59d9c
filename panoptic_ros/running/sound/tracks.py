"""Sound tracks of videos in a run: whose timecode they carry, and which cameras they put on their own clocks.

The frames of a video and its sound are on one time line, the clock of that camera. So where frames have no
stamps but their places in the video, and its sound carries timecode, the timecode says when they were taken.
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
from panoptic_ros.timecode import TimecodeConfig, TimecodeStage

LISTEN_S = 5.0  # to a track of which nobody says what it carries; timecode is understood within 0.3 s
WORDS = 3  # that make sure that it is timecode
SAME_S = 0.002  # between two channels that carry one timecode
SECOND = 1_000_000_000
Sound = Mapping[str, Any]


@dataclass(frozen=True)
class Tracks:
    """What is known of the sound tracks of a capture.

    Args:
        rig: with the clocks of cameras that are stamped by their videos.
        sounds: what is left of those given, with the clocks of the channels.
        notices: one line each.
    """

    rig: Rig
    sounds: tuple[Sound, ...]
    notices: tuple[str, ...] = ()


def find_tracks(
    rig: Rig, sounds: Sequence[Sound], stamped: Collection[str], configs: Mapping[str, Config]
) -> Tracks:
    """Which sound tracks carry timecode, and the cameras that are on their own clocks then.

    A track that sound.yaml names is what it says. Of others the first seconds are heard, if their camera has
    no stamps besides, or is on its own clock by the rig.

    Args:
        sounds: descriptions for `open_sound`.
        stamped: cameras whose frames have stamps besides the times of their videos.

    Raises:
        DataError: if cameras without stamps cannot be held against the others.
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
    return Tracks(replace(rig, cameras=cameras), tuple(kept), tuple(notices))


def _timecode_of(sound: Sound, configs: Mapping[str, Config], clock: str) -> list[str]:
    """The clock of each channel of a sound track, one of which carries timecode; empty: none does.

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
            continue  # one microphone on all channels
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
                f"{other[0].timecode}, on channels {' and '.join(map(str, words))}: say in sound.yaml "
                f"whose they are, e.g. {Path(sound['path']).name}: [A, B]"
            )
    chosen = next(iter(words))
    return [clock if channel == chosen else "" for channel in range(channels)]


def _within() -> Any:
    """Whether a block lies within the seconds that are listened to."""
    firsts: list[int] = []

    def inside(block: AudioBlock) -> bool:
        firsts.append(block.first_sample)
        return block.first_sample - firsts[0] < LISTEN_S * block.sample_rate

    return inside


def _is_same(one: Sequence[TimecodeReading], other: Sequence[TimecodeReading]) -> bool:
    """Whether two channels say the same at the same time."""
    starts = {str(reading.timecode): reading.stamp_ns for reading in one}
    apart = [abs(r.stamp_ns - starts[str(r.timecode)]) for r in other if str(r.timecode) in starts]
    return bool(apart) and max(apart) < SAME_S * SECOND


def _line(tracks: Mapping[str, Sound], silent: Sequence[str], asked: Collection[str]) -> str:
    """A line about tracks that tell nothing."""
    files = ", ".join(Path(tracks[name]["path"]).name for name in silent)
    if not set(silent) & set(asked):
        return (
            f"the sound of {files} is not used: the frames have stamps; if it carries timecode, say so in "
            "sound.yaml"
        )
    return (
        f"no timecode in the first {LISTEN_S:.0f} s of the sound of {files}: their frames are taken as the "
        "videos count them; if it comes later, say so in sound.yaml"
    )


def _require_stamps(
    rig: Rig, sounds: Sequence[Sound], timed: Collection[str], own: Mapping[str, str]
) -> None:
    """Frames that only their videos time cannot be held against timecode that these do not hear."""
    devices = [str(sound["device"]) for sound in sounds]
    named = {clock for sound in sounds for clock in sound["clocks"] if clock and clock not in devices}
    lost = [
        c.name
        for c in rig.cameras
        if c.name not in timed and c.clock not in devices and (own or c.clock in named)
    ]
    if lost:
        others = f"{', '.join(own)} hear timecode" if own else "the rig says that timecode stamps them"
        raise DataError(
            f"{', '.join(lost)} have neither stamps nor timecode in their sound, but {others}: add "
            "timestamps.csv, name their sound tracks in sound.yaml, or leave them out (--cameras)"
        )
