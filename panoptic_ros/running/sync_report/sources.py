"""Stamps and timecode of whatever a report is asked for: a bag, a capture folder, or a file."""

from __future__ import annotations

import struct
from collections import defaultdict
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

from panoptic_ros.capture import VIDEO_SUFFIXES, places_in
from panoptic_ros.capture.sound import known_tracks, read_sound
from panoptic_ros.domain import TimecodeReading
from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.io.bags import BagReader, is_bag
from panoptic_ros.io.messages import from_message
from panoptic_ros.io.stamps import StampTable, read_stamps, stamp_file
from panoptic_ros.io.synctables import read_synctables
from panoptic_ros.stage import Notice, StepResult
from panoptic_ros.timecode import TimecodeConfig, TimecodeStage, decode_recording

FRAMES = {  # types of messages that stand for frames, the best first
    "panoptic_msgs/msg/ViewDetections": "/detections",
    "sensor_msgs/msg/Image": "/image_raw",
    "sensor_msgs/msg/CompressedImage": "/image_raw/compressed",
    "sensor_msgs/msg/CameraInfo": "/camera_info",
}
CHANNELS = 2  # of a recording, that are searched for timecode


@dataclass
class Sources:
    """What was found.

    Args:
        cameras: stamps by camera.
        readings: of all devices, in the order of recording.
        recordings: readings by file and channel, which share their sample index.
        gaps: where sound is missing.
    """

    cameras: dict[str, StampTable] = field(default_factory=dict)
    readings: list[TimecodeReading] = field(default_factory=list)
    recordings: dict[str, list[list[TimecodeReading]]] = field(default_factory=dict)
    gaps: list[Notice] = field(default_factory=list)

    def hear(self, result: StepResult[TimecodeReading]) -> None:
        """Take what the timecode stage found in a block."""
        self.readings += result.outputs
        self.gaps += [notice for notice in result.notices if notice.code == "timecode.gap"]


def collect(path: Path) -> Sources:
    """Read a bag (its folder, or one of its files), a capture folder, or a file.

    Raises:
        DataError: if nothing in it tells of time.
    """
    if not path.exists():
        raise DataError(f"{path} does not exist")
    sources = Sources()
    if is_bag(path):
        _read_bag(path, sources)
    else:
        for place in places_in(path):
            for file in sorted(place.iterdir()):
                _read_file(file, sources, strict=False)
        if path.is_file():
            _read_file(path, sources, strict=True)
    if not sources.cameras and not sources.readings:
        raise DataError(
            f"{path} has no stamps of frames and no timecode; a report needs timestamps.csv (camera, frame, "
            "stamp_ns, or cam_id, frame_time), sync tables, WAV file or video with timecode, or bag with "
            "images, detections or audio"
        )
    return sources


def _read_file(path: Path, sources: Sources, strict: bool) -> None:
    if path.suffix == ".csv" and (strict or path == stamp_file(path.parent)):
        sources.cameras |= read_stamps(path)
    elif path.suffix == ".json" and (strict or "synctables" in path.name):
        for name, stream in read_synctables(path).items():
            stamps, _ = stream.stamps()
            if stamps:
                sources.cameras[name] = StampTable(stamps)
    elif path.suffix.lower() == ".wav" or (path.suffix.lower() in VIDEO_SUFFIXES and known_tracks(path)):
        _read_sound(path, sources)
    elif strict:
        raise DataError(f"{path} is no CSV of stamps, sync table, WAV file, video with sound or bag")


def _read_sound(path: Path, sources: Sources) -> None:
    """Timecode of each channel; the recorder's clock is its count of samples."""
    channels: list[list[TimecodeReading]] = []
    for channel in range(CHANNELS):
        try:
            rate, samples = read_sound(path, channel)
        except UsageError:  # there is no such channel
            if not channel:
                raise
            break
        name = f"{path.stem} channel {channel}"
        channels.append(decode_recording(TimecodeConfig(), name, rate, samples))
    sources.readings += sorted(chain(*channels), key=lambda reading: reading.stamp_ns)
    sources.recordings[path.name] = channels


def _read_bag(path: Path, sources: Sources) -> None:
    with BagReader(path) as bag:
        chosen = _frame_topics(bag)
        timecode = [t for t, kind in bag.topics.items() if kind == "panoptic_msgs/msg/TimecodeReading"]
        audio = [t for t, kind in bag.topics.items() if kind == "panoptic_msgs/msg/AudioBlock"]
        stamps: dict[str, list[int]] = defaultdict(list)
        for topic, _, data, _ in bag.raw(*chosen) if chosen else ():
            if len(data) >= 12:
                order = "<" if data[1] else ">"
                seconds, nanoseconds = struct.unpack_from(order + "iI", data, 4)
                stamps[chosen[topic]].append(seconds * 1_000_000_000 + nanoseconds)
        for name in sorted(stamps):
            sources.cameras[name] = StampTable(stamps[name])
        if timecode:
            for _, _, message in bag.messages(*timecode):
                sources.readings.append(from_message(message, "TimecodeReading"))
        elif audio:
            stage = TimecodeStage(TimecodeConfig())
            for _, _, message in bag.messages(*audio):
                sources.hear(stage.step(from_message(message, "AudioBlock")))
            sources.hear(stage.flush())


def _frame_topics(bag: BagReader) -> dict[str, str]:
    """Topic -> camera, one topic of each camera."""
    chosen: dict[str, str] = {}
    for kind, suffix in FRAMES.items():
        for topic, own in sorted(bag.topics.items()):
            name = topic.removesuffix(suffix).strip("/")
            if own == kind and bag.counts.get(topic) and name not in chosen.values():
                chosen[topic] = name
    return chosen
