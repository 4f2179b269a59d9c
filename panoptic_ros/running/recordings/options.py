"""Options of a recording of a live graph: topics, duration, disk budget. Also checks the room on the disk."""

from __future__ import annotations

import fnmatch
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.bag_split import GB, SplitLimits

FROM_OUTSIDE = (
    "sensor_msgs/msg/Image",
    "sensor_msgs/msg/CompressedImage",
    "sensor_msgs/msg/CameraInfo",
    "sensor_msgs/msg/Imu",
    "sensor_msgs/msg/TimeReference",
    "audio_common_msgs/msg/AudioDataStamped",
    "tf2_msgs/msg/TFMessage",
    "diagnostic_msgs/msg/DiagnosticArray",
)
IMAGES = FROM_OUTSIDE[:2]


@dataclass(frozen=True)
class Selection:
    """Selection of the topics to record.

    Args:
        patterns: shell patterns of full topic names. Empty = input and output topics of a run, without
            intermediate topics.
        images: whether an empty selection includes images.
    """

    patterns: Sequence[str] = ()
    images: bool = True

    def wants(self, topic: str, kind: str) -> bool:
        """Return whether a topic with messages of that type is recorded."""
        if self.patterns:
            return any(fnmatch.fnmatchcase(topic, pattern) for pattern in self.patterns)
        if kind in IMAGES and not self.images:
            return False
        rows = [row for row in TOPICS.values() if row.recorded]
        named = any(row.message == kind and topic.endswith("/" + row.name.split("}/")[-1]) for row in rows)
        return kind in FROM_OUTSIDE or named


@dataclass
class RecordOptions:
    """Options of a recording.

    Args:
        duration_s: Duration, s; None = until a request to end.
        budget_gb: Maximum size, GB; 0 = limited by the disk only.
        keep_free_gb: Free space to leave on the disk, GB.
        rig: Calibration file to store in the bag, if the graph publishes no rig.
        split: How to split the recording into several bags; None = one bag.
    """

    selection: Selection = field(default_factory=Selection)
    duration_s: float | None = None
    budget_gb: float = 0.0
    keep_free_gb: float = 1.0
    rig: Path | None = None
    split: SplitLimits | None = None


def told_room(path: Path, rates: Mapping[str, float], options: RecordOptions) -> str:
    """Return a line that states how much recording time fits on the disk.

    Args:
        path: path of the recording.
        rates: bytes per second by topic.

    Raises:
        EnvironmentProblem: if the requested duration does not fit.
    """
    total = sum(rates.values())
    place = next(p for p in (path, *path.resolve().parents) if p.exists())
    free = shutil.disk_usage(place).free - options.keep_free_gb * GB
    room = min(free, options.budget_gb * GB) if options.budget_gb else free
    line = f"{total / 1e6:.2f} MB/s on {len(rates)} topics, {3600 * total / GB:.1f} GB an hour"
    if not total:
        return f"no messages on the topics yet; room for {room / GB:.1f} GB"
    seconds = room / total
    if options.duration_s is not None and seconds < options.duration_s:
        raise EnvironmentProblem(
            f"{options.duration_s:g} s need {options.duration_s * total / GB:.2f} GB, but there is room for "
            f"{max(0.0, room) / GB:.2f} GB ({line}); free some, or use --no-images, --topic, --keep-free"
        )
    largest = max(rates, key=lambda topic: rates[topic])
    return f"{line} (most of it {largest}); room for {room / GB:.1f} GB, {seconds / 3600:.1f} h"
