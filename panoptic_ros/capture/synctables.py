"""Read the frame timestamps of a capture folder from the sync tables of CMU's Panoptic Studio."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.errors import DataError
from panoptic_ros.io.synctables import COLOR_LATE_MS, DEMO_BASE, SyncStream, read_synctables

NODE = "KINECTNODE"
HD_BASE_TOLD = (
    f"frame N of HD cameras has the time of entry N + {DEMO_BASE} of hd.univ_time, as in CMU's "
    "demo, which is disputed; test it if it matters"
)


def table_files(path: Path) -> list[Path]:
    """Return the files synctables*.json and ksynctables*.json of a folder."""
    return [*sorted(path.glob("synctables*.json")), *sorted(path.glob("ksynctables*.json"))]


def tabled_notices(rig: Rig) -> tuple[str, ...]:
    """Return notices for users of sync tables about the assumed HD frame index."""
    return (HD_BASE_TOLD,) if any(_stream_of(camera) == "hd" for camera in rig.cameras) else ()


def table_times(path: Path, rig: Rig) -> dict[str, dict[int, int]]:
    """Return the timestamps (ns) by frame number of every camera.

    HD and VGA cameras share the times of their type. A Kinect is named KINECTNODE<n>, or 50_<n> as in CMU's
    calibration. Its color timestamps are 6.25 ms late, as in CMU's demo.

    Raises:
        DataError: if the tables are damaged, or lack a camera.
    """
    streams = read_synctables(*table_files(path))
    return {camera.name: _times(streams, camera, path) for camera in rig.cameras}


def _times(streams: Mapping[str, SyncStream], camera: Camera, path: Path) -> dict[int, int]:
    name = _stream_of(camera)
    if name not in streams:
        raise DataError(
            f"{path}: sync tables have no {name} for camera {camera.name}; they have {', '.join(streams)}"
        )
    stream = streams[name]
    base = DEMO_BASE if name == "hd" else 0
    late = COLOR_LATE_MS if name.startswith("color/") else 0.0
    there = np.flatnonzero(np.isfinite(stream.times_ms))
    rows = ((int(stream.index[k]) - base, round(1e6 * (stream.times_ms[k] - late))) for k in there)
    return {frame: stamp for frame, stamp in rows if frame >= 0}


def _stream_of(camera: Camera) -> str:
    """Return the stream with the times of a camera, by its name or its type."""
    named = re.fullmatch(rf"(?:{NODE}|50_)0*(\d+)", camera.name, re.IGNORECASE)
    if named:
        return f"color/{NODE}{named[1]}"
    return "vga" if camera.type == "vga" else "hd"
