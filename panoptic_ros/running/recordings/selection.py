"""Which topics of a live graph are recorded."""

from __future__ import annotations

import fnmatch
from collections.abc import Sequence
from dataclasses import dataclass

from panoptic_ros.graph.topics import TOPICS

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
    """Which topics are recorded.

    Args:
        patterns: of whole names, as a shell has them; empty: what a run needs and gives, without what lies
            between. images: whether images are among these.
    """

    patterns: Sequence[str] = ()
    images: bool = True

    def wants(self, topic: str, kind: str) -> bool:
        """Whether a topic with messages of that kind is recorded."""
        if self.patterns:
            return any(fnmatch.fnmatchcase(topic, pattern) for pattern in self.patterns)
        if kind in IMAGES and not self.images:
            return False
        rows = [row for row in TOPICS.values() if row.recorded]
        named = any(row.message == kind and topic.endswith("/" + row.name.split("}/")[-1]) for row in rows)
        return kind in FROM_OUTSIDE or named
