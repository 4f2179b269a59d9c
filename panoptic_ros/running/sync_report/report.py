"""Makes the report about the clocks of a capture.

The timestamps and timecodes come from a bag, a capture folder, or a single file.
"""

from __future__ import annotations

import re
import struct
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.capture import VIDEO_SUFFIXES, places_in
from panoptic_ros.capture.sound import known_tracks, read_sound
from panoptic_ros.clocks.config import ClocksConfig
from panoptic_ros.clocks.report import CameraClockReport, findings, measure_camera, phase_s, timecode_findings
from panoptic_ros.clocks.stage import ClocksStage
from panoptic_ros.clocks.stereo import LEAST_READINGS, align_timecodes
from panoptic_ros.domain import Camera, ClockModel, Rig, SkeletonModel, TimecodeReading, ViewDetections
from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.io.bags import BagReader, bag_in
from panoptic_ros.io.files import file_errors, write_json
from panoptic_ros.io.messages import from_message
from panoptic_ros.io.stamps import StampTable, read_stamps, stamp_file
from panoptic_ros.io.synctables import read_synctables
from panoptic_ros.stage import Notice, StageContext, StepResult
from panoptic_ros.sync import SyncConfig, SyncStage
from panoptic_ros.timecode.config import TimecodeConfig
from panoptic_ros.timecode.recording import decode_recording
from panoptic_ros.timecode.stage import TimecodeStage
from panoptic_ros.view.sync_plot import write_sync_plot

FORMAT = "panoptic-sync-report-1"
SECOND = 1_000_000_000
FRAMES = {  # message types that represent frames, best first, with the ends of their topic names
    "panoptic_msgs/msg/ViewDetections": "/detections",
    "sensor_msgs/msg/Image": "/image_raw",
    "sensor_msgs/msg/CompressedImage": "/image_raw/compressed",
    "sensor_msgs/msg/CameraInfo": "/camera_info",
}
PREVIEW = "/preview/compressed"  # end of topics with previews, which show only some of the images of a camera
CHANNELS = 2  # channels of a recording that are searched for timecode


@dataclass
class Sources:
    """Timestamps and timecodes of a capture.

    Args:
        cameras: timestamps by camera.
        readings: timecode readings of all devices, in order of recording.
        recordings: timecode readings by file and channel. The channels share their sample index.
        gaps: notices about missing sound.
    """

    cameras: dict[str, StampTable] = field(default_factory=dict)
    readings: list[TimecodeReading] = field(default_factory=list)
    recordings: dict[str, list[list[TimecodeReading]]] = field(default_factory=dict)
    gaps: list[Notice] = field(default_factory=list)

    def hear(self, result: StepResult[TimecodeReading]) -> None:
        """Add the readings and gaps that the timecode stage found in a block."""
        self.readings += result.outputs
        self.gaps += [notice for notice in result.notices if notice.code == "timecode.gap"]


def collect(path: Path) -> Sources:
    """Read a bag (its folder, or one of its files), the results of a run, a capture folder, or a file.

    Raises:
        DataError: if it contains no timestamps and no timecode.
    """
    if not path.exists():
        raise DataError(f"{path} does not exist")
    sources = Sources()
    bag = bag_in(path)
    if bag is not None:
        _read_bag(bag, sources)
    else:
        for place in places_in(path):
            for file in sorted(place.iterdir()):
                _read_file(file, sources, strict=False)
        if path.is_file():
            _read_file(path, sources, strict=True)
    if not sources.cameras and not sources.readings:
        raise DataError(
            f"{path} has no stamps of frames and no timecode, so there is nothing to report; a report needs "
            "timestamps.csv (camera, frame, stamp_ns, or cam_id, frame_time), sync tables, a WAV file or "
            "video with timecode, or a bag with images, detections or audio"
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
        raise DataError(f"{path} is not a CSV of stamps, sync table, WAV file, video with sound or bag")


def _read_sound(path: Path, sources: Sources) -> None:
    """Decode the timecode of each channel. The count of samples is the recorder's clock."""
    channels: list[list[TimecodeReading]] = []
    for channel in range(CHANNELS):
        try:
            rate, samples = read_sound(path, channel)
        except UsageError:  # the file has no such channel
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
    """Return the camera by topic, with one topic per camera."""
    chosen: dict[str, str] = {}
    for kind, suffix in FRAMES.items():
        for topic, own in sorted(bag.topics.items()):
            name = topic.removesuffix(suffix).strip("/")
            if own != kind or topic.endswith(PREVIEW) or not bag.counts.get(topic):
                continue
            if name not in chosen.values():
                chosen[topic] = name
    return chosen


@dataclass(frozen=True)
class SyncReport:
    """Report about the clocks of a capture.

    Args:
        document: content of sync_report.json.
        cameras: measurements of the cameras, in the order of the document.
        models: clock models of the devices with timecode.
    """

    document: dict[str, Any]
    cameras: Sequence[CameraClockReport]
    models: Mapping[str, ClockModel]

    @property
    def warned(self) -> bool:
        """Return whether the report contains a warning, i.e. a fault that the user can fix."""
        return any(note["severity"] == "warning" for note in self.document["notices"])


def report_clocks(path: Path) -> SyncReport:
    """Return the report about a bag, a capture folder, or a file; see `collect`.

    Raises:
        DataError: if it contains no timestamps and no timecode.
    """
    sources = collect(path)
    cameras, short = _measure(sources)
    models, told = _clock_models(sources)
    notices = (*short, *findings(cameras), *timecode_findings([*sources.gaps, *told]))
    document = {
        "format": FORMAT,
        "cameras": [_camera_row(camera, cameras[0]) for camera in cameras],
        "devices": [_device_row(model) for model in models.values()],
        "aligned": _aligned(sources),
        "grouping": _grouping(sources, [camera.name for camera in cameras]),
        "notices": [vars(note) | {"values": dict(note.values)} for note in notices],
    }
    return SyncReport(document, cameras, models)


def write_report(folder: Path, report: SyncReport) -> None:
    """Write sync_report.json and sync.png.

    Raises:
        EnvironmentProblem: if they cannot be written.
    """
    with file_errors(folder, "write"):
        folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / "sync_report.json", report.document, indent=1)
    write_sync_plot(folder / "sync.png", report.cameras, report.models)


def _measure(sources: Sources) -> tuple[list[CameraClockReport], list[Notice]]:
    cameras, short = [], []
    for name, table in sources.cameras.items():
        try:
            cameras.append(measure_camera(name, table.stamps_ns, table.numbers))
        except DataError as error:
            short.append(Notice("sync_report.too_short", "warning", str(error), {"camera": name}))
    return cameras, short


def _clock_models(sources: Sources) -> tuple[dict[str, ClockModel], list[Notice]]:
    stage = ClocksStage(ClocksConfig())
    results = [stage.step(reading) for reading in sources.readings] + [stage.flush()]
    models = {model.device: model for result in results for model in result.outputs}
    return models, [notice for result in results for notice in result.notices]


def _camera_row(camera: CameraClockReport, first: CameraClockReport) -> dict[str, Any]:
    timing = camera.timing
    row = {
        "camera": camera.name,
        "frames": len(timing.counts),
        "rate_hz": timing.rate_hz,
        "rate_std_hz": timing.rate_std_hz,
        "nominal_hz": camera.nominal_hz,
        "off_ppm": camera.off_ppm,
        "phase_ms": 1e3 * phase_s(first, camera),
        "jitter_ms": 1e3 * timing.jitter_s,
        "interval_std_ms": 1e3 * timing.interval_std_s,
        "late_p99_ms": 1e3 * camera.late_p99_s,
        "lost": timing.lost,
        "gaps": timing.gaps,
        "stamps_back": timing.not_later,
        "beat_ms": 1e3 * camera.beat_s,
        "host_grid": camera.paced,
        "one_way": timing.one_way,
    }
    return {k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in row.items()}


def _device_row(model: ClockModel) -> dict[str, Any]:
    master, std = model.master_from_device(model.until_ns)
    return {
        "device": model.device,
        "stamp_ns": model.until_ns,
        "master_ns": int(master),
        "offset_s": (int(master) - model.until_ns) / SECOND,
        "drift_ppm": 1e6 * model.drift,
        "drift_std_ppm": 1e6 * float(np.sqrt(model.covariance[1, 1])),
        "std_us": 1e-3 * std,
        "segment": model.segment,
    }


def _aligned(sources: Sources) -> list[dict[str, Any]]:
    """Return offset and drift between the two timecodes of every recording with two such channels."""
    rows = []
    for name, channels in sources.recordings.items():
        if len(channels) == 2 and all(len(found) >= LEAST_READINGS for found in channels):
            model = align_timecodes(channels[0], channels[1], "channel 1")
            row = _device_row(model)
            rows.append(
                {
                    "recording": name,
                    "offset_s": row["offset_s"],
                    "drift_ppm": row["drift_ppm"],
                    "std_us": row["std_us"],
                }
            )
    return rows


def _grouping(sources: Sources, cameras: Sequence[str]) -> dict[str, Any] | None:
    """Return statistics of the sets that sync forms by default; None for fewer than two cameras."""
    if len(cameras) < 2:
        return None
    names = {name: re.sub(r"\W", "_", name) for name in cameras}
    intrinsics = Intrinsics(np.array([[1.0, 0, 1], [0, 1, 1], [0, 0, 1]]), np.zeros(5))
    rig = Rig(tuple(Camera(own, (2, 2), intrinsics, Rigid.identity()) for own in names.values()))
    skeleton = SkeletonModel("none", ("a", "b"), 0, ((0, 1),), 0)
    nobody = np.zeros((0, 2, 2)), np.zeros((0, 2)), np.zeros(0)
    views = [
        ViewDetections(names[name], stamp, k, (2, 2), skeleton.hash, *nobody)
        for name in cameras
        for k, stamp in enumerate(sources.cameras[name].stamps_ns)
    ]
    stage = SyncStage(SyncConfig(queue_limit=100_000), StageContext(rig, skeleton))
    views.sort(key=lambda view: view.stamp_ns)
    results = [stage.step(view) for view in views] + [stage.flush()]
    sets = [item for result in results for item in result.outputs]
    codes = Counter(notice.code for result in results for notice in result.notices)
    used = [(view.camera, view.frame_number) for item in sets for view in item.views]
    away = [abs(view.stamp_ns - item.stamp_ns) / 1e6 for item in sets for view in item.views]
    return {
        "frames": len(views),
        "sets": len(sets),
        "used": len(used),
        "used_twice": len(used) - len(set(used)),
        "views_per_set": len(used) / max(1, len(sets)),
        "away_ms_mean": float(np.mean(away)) if away else None,
        "away_ms_max": float(np.max(away)) if away else None,
        "notices": dict(sorted(codes.items())),
    }
