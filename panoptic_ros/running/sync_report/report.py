"""The report about the clocks of a capture."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.clocks import ClocksConfig, ClocksStage
from panoptic_ros.clocks.report import CameraClock, findings, measure_camera, phase_s, timecode_findings
from panoptic_ros.clocks.stereo import LEAST_READINGS, align_timecodes
from panoptic_ros.domain import Camera, ClockModel, Rig, SkeletonModel, ViewDetections
from panoptic_ros.errors import DataError
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.io.files import file_errors, write_json
from panoptic_ros.running.sync_report.sources import Sources, collect
from panoptic_ros.stage import Notice, StageContext
from panoptic_ros.sync import SyncConfig, SyncStage
from panoptic_ros.view.sync_plot import write_sync_plot

FORMAT = "panoptic-sync-report-1"
SECOND = 1_000_000_000


@dataclass(frozen=True)
class SyncReport:
    """What the clocks of a capture do.

    Args:
        document: the content of sync_report.json.
        cameras: what was measured, in the order of the document.
        models: of devices with timecode.
    """

    document: dict[str, Any]
    cameras: Sequence[CameraClock]
    models: Mapping[str, ClockModel]

    @property
    def warned(self) -> bool:
        """Whether something is wrong that the user can mend."""
        return any(note["severity"] == "warning" for note in self.document["notices"])


def report_clocks(path: Path) -> SyncReport:
    """The report about a bag, a capture folder, or a file; see `collect`.

    Raises:
        DataError: if nothing in it tells of time.
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


def _measure(sources: Sources) -> tuple[list[CameraClock], list[Notice]]:
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


def _camera_row(camera: CameraClock, first: CameraClock) -> dict[str, Any]:
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
    """Two timecodes on the channels of one recording."""
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
    """What sync makes of these stamps with its defaults."""
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
