"""Making source nodes from a plain description, as it stands in a launcher's file or in parameters."""
from __future__ import annotations

import heapq
import struct
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from panoptic_ros.capture import DepthSource, open_source
from panoptic_ros.domain import Rig
from panoptic_ros.graph.topics import TOPICS, ros_name
from panoptic_ros.io.bags import BagReader
from panoptic_ros.nodes.source_node import Outgoing, SourceNode, camera_messages, camera_topics


def make_camera_node(
    camera: str, rig: Rig, source: Mapping[str, Any], overrides: Mapping[str, Any], jpeg_quality: int
) -> SourceNode:
    """A node that publishes one camera's images.

    Args:
        source: see `capture.open_source`.
        jpeg_quality: 0 = raw images.

    Raises:
        UserError: as the source's opening.
    """
    frames, calibrated = open_source(camera, rig, source)
    detections = TOPICS["detections"].of(camera)
    topics = camera_topics(camera, bool(jpeg_quality), isinstance(frames, DepthSource))
    node = SourceNode(f"camera_{ros_name(camera)}", topics, overrides, {"image": detections})
    node.start(camera_messages(frames, calibrated, jpeg_quality))
    return node


def make_bag_node(
    path: Path, cameras: Mapping[str, str], overrides: Mapping[str, Any], images: bool,
    depths: Sequence[str] = (),
) -> SourceNode:  # fmt: skip
    """A node that publishes topics of a bag as they are, merged by the stamps of their headers.

    Args:
        cameras: topic -> camera.
        images: whether they are images, of which fewer may be under way.
        depths: topics of depth maps.
    """
    with BagReader(path) as reader:
        topics = [*cameras, *depths]
        publishers = {topic: (topic, reader.topics[topic]) for topic in topics}
    detections = {topic: TOPICS["detections"].of(camera) for topic, camera in cameras.items() if images}
    node = SourceNode("bag", publishers, overrides, detections, max(1, len(topics)))
    node.start(_merged(path, topics))
    return node


def _merged(path: Path, topics: list[str]) -> Iterator[Outgoing]:
    streams = [_stamped(path, topic, order) for order, topic in enumerate(topics)]
    for stamp, _, topic, data in heapq.merge(*streams, key=lambda row: row[:2]):
        yield Outgoing(stamp, ((topic, data),))


def _stamped(path: Path, topic: str, order: int) -> Iterator[tuple[int, int, str, bytes]]:
    """Messages of one topic as they are, with the stamp that stands first in them."""
    with BagReader(path) as reader:
        for _, _, data, _ in reader.raw(topic):
            seconds, nanoseconds = struct.unpack_from("<iI", data, 4)
            yield seconds * 1_000_000_000 + nanoseconds, order, topic, bytes(data)
