"""Cut a small bag from that of a run: rig, skeleton model, and the 2D people of its first second.

    python bags/cut_sample.py RUN/bag SAMPLE
"""
from __future__ import annotations

import sys
from pathlib import Path

from panoptic_ros.domain import ViewDetections
from panoptic_ros.io.bags import BagReader, BagWriter
from panoptic_ros.io.messages import bag_messages, from_message, stamp_of, to_message

SECONDS = 1.0


def cut(source: Path, target: Path) -> None:
    """Write `target`; score maps are left out, as they are most of the size."""
    with BagReader(source) as bag, BagWriter(target) as sample:
        topics = [t for t in bag.topics if t in ("/rig", "/skeleton_model") or t.endswith("/detections")]
        first = None
        for topic, stamp, message in bag.messages(*topics):
            if not topic.endswith("/detections"):
                sample.write(topic, stamp, message)
                continue
            first = stamp_of(message.header) if first is None else first
            if stamp_of(message.header) - first < SECONDS * 1e9:
                view = from_message(message, "ViewDetections")
                bare = ViewDetections(
                    view.camera, view.stamp_ns, view.frame_number, view.image_size, view.skeleton_hash,
                    view.points, view.scores, view.person_scores,
                )  # fmt: skip
                sample.write(topic, stamp, to_message(bare, bag_messages()))


if __name__ == "__main__":
    cut(Path(sys.argv[1]), Path(sys.argv[2]))
