"""Opening a source from a plain description, as it stands in a run's plan and in a launcher's file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from panoptic_ros.capture.folder import open_capture_folder, open_files
from panoptic_ros.capture.live import open_live
from panoptic_ros.capture.played import PlayedSource
from panoptic_ros.capture.source import FrameSource
from panoptic_ros.domain import Camera, Rig
from panoptic_ros.errors import UsageError


def open_source(camera: str, rig: Rig, description: Mapping[str, Any]) -> tuple[FrameSource, Camera]:
    """One camera's frames, and the camera as calibrated for their size.

    Args:
        description: {"kind": "folder" | "file" | "device" | "played", "path" or "device", and what opening
            takes}; of a folder that is played, "rate_hz" and "start_ns" (see `PlayedSource`).

    Raises:
        UserError: as `open_capture_folder`, `open_files` and `open_live`.
    """
    kind = description["kind"]
    options = {k: v for k, v in description.items() if k not in ("kind", "path", "device")}
    if kind == "device":
        return open_live(camera, rig, description["device"], options), rig.camera(camera)
    if kind == "played":
        capture = open_capture_folder(Path(description["path"]), rig=rig, cameras=[camera])
        return PlayedSource(capture.sources[0], options["rate_hz"], options["start_ns"]), rig.camera(camera)
    if kind == "folder":
        capture = open_capture_folder(Path(description["path"]), rig=rig, cameras=[camera], **options)
    elif kind == "file":
        capture = open_files(rig.subset([camera]), {camera: Path(description["path"])}, **options)
    else:
        raise UsageError(f"camera {camera}: there is no source of kind {kind!r}")
    return capture.sources[0], capture.rig.camera(camera)
