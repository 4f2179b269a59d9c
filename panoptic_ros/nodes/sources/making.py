"""Making source nodes from a plain description, as it stands in a launcher's file or in parameters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from heapq import merge
from pathlib import Path
from typing import Any

from panoptic_ros.capture import DepthSource, FrameSource, open_source
from panoptic_ros.capture.imus import imu_samples
from panoptic_ros.capture.sound import open_sound
from panoptic_ros.domain import Rig
from panoptic_ros.graph.topics import TOPICS, ros_name
from panoptic_ros.io.bag_streams import IMU_KEY, SOUND_KEY, BagMessage, BagStream, StreamEnd, merged
from panoptic_ros.nodes.sources.source_node import (
    Outgoing,
    SourceNode,
    camera_messages,
    camera_topics,
    imu_messages,
    sound_messages,
)


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
    node.start(_noted(camera_messages(frames, calibrated, jpeg_quality), frames, node))
    return node


def _noted(outgoing: Iterator[Outgoing], source: FrameSource, node: SourceNode) -> Iterator[Outgoing]:
    """Yield the messages of a source; after the last one the node counts its notices."""
    yield from outgoing
    for notice in getattr(source, "after", ()):  # live sources have no last frame
        node.note(notice)


def make_sound_node(
    sound: Mapping[str, Any], cameras: Sequence[str], overrides: Mapping[str, Any]
) -> SourceNode:
    """A node that publishes what a device heard.

    Args:
        sound: see `capture.sound.open_sound`.
        cameras: beside it.

    Raises:
        UserError: as the source's opening.
    """
    source, topic = open_sound(sound), TOPICS["audio"]
    topics = {"audio": (topic.of(source.device), topic.message)}
    node = SourceNode(f"sound_{ros_name(source.device)}", topics, overrides, sound_beside=cameras)
    node.start(sound_messages(source))
    return node


def make_imu_node(
    imus: Mapping[str, str],
    cameras: Sequence[str],
    overrides: Mapping[str, Any],
    until_ns: int | None = None,
) -> SourceNode:
    """A node that publishes what IMUs measured.

    Args:
        imus: file of samples by device. cameras: beside them. until_ns: see `imu_samples`.

    Raises:
        UserError: as the files' reading.
    """
    topic = TOPICS[IMU_KEY]
    topics = {device: (topic.of(device), topic.message) for device in imus}
    node = SourceNode("imus", topics, overrides, sound_beside=cameras)
    paths = dict.fromkeys(imus.values())
    every = (imu_samples(Path(path), [d for d in imus if imus[d] == path], until_ns) for path in paths)
    node.start(imu_messages(merge(*every, key=lambda sample: sample.stamp_ns)))
    return node


def make_bag_node(streams: Sequence[BagStream], overrides: Mapping[str, Any]) -> SourceNode:
    """A node that publishes cameras' topics of bags, merged by their stamps, under the graph's names.

    What cannot be decoded is not sent: the middleware would lose it without a word.
    """
    names = {stream: TOPICS[stream.key].of(stream.camera) for stream in streams}
    topics = {name: (name, TOPICS[stream.key].message) for stream, name in names.items()}
    images = [stream for stream in streams if stream.key in ("image", "compressed_image")]
    detections = {names[stream]: TOPICS["detections"].of(stream.camera) for stream in images}
    alone = () if all(stream.key == IMU_KEY for stream in streams) else None
    node = SourceNode("bag", topics, overrides, detections, alone)
    node.start(_outgoing(item, names[item.stream]) for item in merged(streams, node.refuse))
    return node


def _outgoing(item: BagMessage | StreamEnd, key: str) -> Outgoing:
    if isinstance(item, StreamEnd):
        return Outgoing(item.place_ns, ended=key)
    return Outgoing(item.place_ns, ((key, item.data),), is_sound=item.stream.key in (SOUND_KEY, IMU_KEY))
