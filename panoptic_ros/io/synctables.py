"""Read sync tables of CMU's Panoptic Studio: synctables_<sequence>.json and ksynctables_<sequence>.json.

The arrays hd.univ_time, kinect.color.KINECTNODE<n>.univ_time and kinect.depth.KINECTNODE<n>.univ_time are
times in ms of one clock. Values of 0 and below are missing frames. `index`, if present, is the frame in the
video file.

Sources disagree on the element of hd.univ_time that belongs to image file N. The toolbox's own MATLAB demo
uses univ_time(N + 2), which is element N + 1 counted from 0 ("-2 is some weired offset in synctables"). Ports
use N, N + 1 or N + 2. `hd_base` selects the offset; 1 is the demo's. Test it with an event that both streams
show.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.errors import DataError, shown
from panoptic_ros.io.documents import read_json
from panoptic_ros.io.known_keys import EACH, OTHERS, keys, tell_unknown
from panoptic_ros.io.loading import parsing

Array = np.ndarray
HD_BASES = (0, 1, 2)
DEMO_BASE = 1
LATEST_MS = 9.2e12  # ms; the largest timestamp that fits into 63 bits of ns, 292 years
_TABLE = keys(f"univ_time index {OTHERS}")
KEYS = keys(OTHERS, hd=_TABLE, vga=_TABLE, kinect=keys(OTHERS, color={EACH: _TABLE}, depth={EACH: _TABLE}))
COLOR_LATE_MS = 6.25  # ms; CMU's demo subtracts this delay of color against depth timestamps
# ms, gates of CMU's demo: beyond them it uses no frame.
GATE_DEPTH_COLOR_MS, GATE_COLOR_MS, GATE_DEPTH_MS = 6.5, 30.0, 17.0


@dataclass(frozen=True, eq=False)
class SyncStream:
    """Times of one stream.

    Args:
        times_ms: (N,) ms; NaN = missing frame.
        index: (N,) frame index in the video file.
    """

    name: str
    times_ms: Array
    index: Array

    def stamps(self) -> tuple[list[int], list[int]]:
        """Return the timestamps (ns) and frame indices of the frames that exist."""
        there = np.isfinite(self.times_ms)
        return [round(1e6 * t) for t in self.times_ms[there]], self.index[there].tolist()

    def nearest(self, time_ms: float) -> int | None:
        """Return the index of the element nearest in time; None if the stream has no frame."""
        away = np.abs(self.times_ms - time_ms)
        return int(np.nanargmin(away)) if np.isfinite(away).any() else None


@dataclass(frozen=True)
class KinectMatch:
    """Frames of one Kinect for an HD frame, as indices into its videos; None = no frame within the gate."""

    color: int | None
    depth: int | None


def read_synctables(*paths: Path) -> dict[str, SyncStream]:
    """Read the streams by name: "hd", "vga" if present, "color/KINECTNODE1", "depth/KINECTNODE1", ...

    Raises:
        DataError: naming the file and the entry that is not a table of times.
    """
    streams: dict[str, SyncStream] = {}
    for path in paths:
        document = read_json(path)
        if not isinstance(document, dict):
            raise DataError(f"{path} is not a sync table: an object with hd or kinect is expected")
        tell_unknown(document, KEYS, path)
        with parsing(path):
            for system in ("hd", "vga"):
                if system in document:
                    streams[system] = _stream(system, document[system], path)
            for kind in ("color", "depth"):
                for node, table in document.get("kinect", {}).get(kind, {}).items():
                    streams[f"{kind}/{node}"] = _stream(f"{kind}/{node}", table, path)
    if not streams:
        raise DataError(f"{', '.join(map(str, paths))}: no sync table with hd, vga or kinect")
    return streams


def hd_time_ms(streams: Mapping[str, SyncStream], frame: int, hd_base: int = DEMO_BASE) -> float:
    """Return the time (ms) of HD image file `frame` (counted from 0); NaN if it is missing.

    Raises:
        DataError: for a base other than 0, 1 and 2, a frame beyond the table, or tables without hd.
    """
    if hd_base not in HD_BASES:
        raise DataError(f"the base of HD indices is {hd_base}; it can be 0, 1 (CMU's demo) or 2")
    if "hd" not in streams:
        raise DataError("the sync tables have no hd; read synctables_<sequence>.json as well")
    times = streams["hd"].times_ms
    if not 0 <= frame + hd_base < len(times):
        raise DataError(f"HD frame {frame} is beyond the sync table, which has {len(times)} entries")
    return float(times[frame + hd_base])


def match_kinects(
    streams: Mapping[str, SyncStream], frame: int, hd_base: int = DEMO_BASE
) -> dict[str, KinectMatch]:
    """Return the frames of every Kinect at an HD frame, within the gates of CMU's demo (30, 17 and 6.5 ms).

    Raises:
        DataError: see `hd_time_ms`.
    """
    time = hd_time_ms(streams, frame, hd_base)
    nodes = sorted({name.partition("/")[2] for name in streams if "/" in name})
    return {node: _match(streams, node, time) for node in nodes}


def _match(streams: Mapping[str, SyncStream], node: str, time: float) -> KinectMatch:
    color, color_time = _near(streams.get(f"color/{node}"), time, COLOR_LATE_MS, GATE_COLOR_MS)
    depth, depth_time = _near(streams.get(f"depth/{node}"), time, 0.0, GATE_DEPTH_MS)
    if color is not None and depth is not None and abs(color_time - depth_time) > GATE_DEPTH_COLOR_MS:
        return (
            KinectMatch(None, depth)
            if abs(depth_time - time) <= abs(color_time - time)
            else (KinectMatch(color, None))
        )
    return KinectMatch(color, depth)


def _near(stream: SyncStream | None, time: float, late: float, gate: float) -> tuple[int | None, float]:
    element = None if stream is None or np.isnan(time) else stream.nearest(time + late)
    if stream is None or element is None or abs(stream.times_ms[element] - late - time) > gate:
        return None, float("nan")
    return int(stream.index[element]), float(stream.times_ms[element] - late)


def _stream(name: str, table: Any, path: Path) -> SyncStream:
    values = table.get("univ_time") if isinstance(table, dict) else None
    if not isinstance(values, list) or not values:
        raise DataError(f"{path}: {name}.univ_time is {shown(values)}, expected a list of numbers")
    try:
        times = np.array(values, float)
        index = np.array(table.get("index", range(len(times))), int)
    except (TypeError, ValueError, OverflowError):
        raise DataError(f"{path}: {name}.univ_time is not a list of numbers") from None
    if times.ndim != 1 or index.shape != times.shape:
        raise DataError(f"{path}: {name} has {times.size} times and {index.size} indices")
    if times.max() > LATEST_MS:
        raise DataError(f"{path}: {name}.univ_time has {times.max():g} ms, which is not a time")
    return SyncStream(name, np.where(times > 0.0, times, np.nan), index)
