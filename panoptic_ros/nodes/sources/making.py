"""Source nodes for cameras (devices and files), audio, IMUs and bags.

They are made from a plain description, which comes from a launcher's file or from parameters. They publish in
the selected flow.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from heapq import merge
from pathlib import Path
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter

from panoptic_ros.capture import DepthSource, FrameSource, open_source
from panoptic_ros.capture.imus import imu_samples
from panoptic_ros.capture.sound import open_sound
from panoptic_ros.domain import AudioBlock, Camera, ImuSample, Rig
from panoptic_ros.errors import DataError, PanopticError
from panoptic_ros.graph.counters import StageStatistics
from panoptic_ros.graph.flow import PATIENT
from panoptic_ros.graph.health import NodeHealth
from panoptic_ros.graph.topics import TOPICS, ros_name
from panoptic_ros.io.bag_streams import IMU_KEY, SOUND_KEY, BagMessage, BagStream, StreamEnd, merged
from panoptic_ros.io.messages import (
    camera_info_message,
    compressed_image_message,
    depth_message,
    image_message,
    to_message,
)
from panoptic_ros.nodes.health.diagnostics import Diagnostics
from panoptic_ros.nodes.middleware.family import message_class, ros_messages
from panoptic_ros.nodes.middleware.parameters import declare_flow
from panoptic_ros.nodes.middleware.quality import data_quality
from panoptic_ros.nodes.middleware.runtime import quiet_once
from panoptic_ros.nodes.middleware.streams import STALL_S, Credit, SoundCredit, StreamEnds
from panoptic_ros.stage import Notice

IMU = TOPICS["imu"].message
FREQUENT = (TOPICS["audio"].message, IMU)


@dataclass(frozen=True)
class OutgoingMessages:
    """Messages to publish together, or the end of a publisher.

    Args:
        stamp_ns: Timestamp of the messages.
        messages: (key of the publisher, message).
        overtaken: Number of frames that a live source skipped before these messages.
        is_sound: Whether the messages are audio or IMU samples. These are sent ahead and do not wait for
            skeletons.
        ended: Key of a publisher that sends no more. There are no messages then.
    """

    stamp_ns: int
    messages: tuple[tuple[str, Any], ...] = ()
    overtaken: int = 0
    is_sound: bool = False
    ended: str = ""


class SourceNode(Node):
    """Node that publishes the items of an iterator from a separate thread.

    Parameters: `flow` and `replay_window` as in `StageNode`. `shift_ns` is added to timestamps in replay, for
    a comparison with those of skeletons. `readers`, for IMUs without cameras only, is the number of
    subscribers to wait for, per topic and for bodies.

    Args:
        topics: key -> (topic, message type) of the publishers. Flow control counts an item under its first
            key.
        detections: For publishers of images, by key: the topic whose messages show that an image was
            processed.
        sound_beside: For sources of audio or IMUs: the cameras that run too. IMUs without cameras wait for
            bodies instead. None: the source publishes images or detections.
    """

    def __init__(
        self,
        name: str,
        topics: Mapping[str, tuple[str, str]],
        overrides: Mapping[str, Any] = {},
        detections: Mapping[str, str] = {},
        sound_beside: Sequence[str] | None = None,
    ):
        super().__init__(
            name, parameter_overrides=[Parameter(k, value=value) for k, value in overrides.items()]
        )
        self._flow = declare_flow(self)
        self._publishers_by_key = {
            key: self.create_publisher(
                message_class(kind),
                topic,
                data_quality(self._flow, key in detections, kind in FREQUENT),
            )
            for key, (topic, kind) in topics.items()
        }
        self._sent = dict.fromkeys(topics, 0)
        self._ended: set[str] = set()
        self._statistics = StageStatistics()
        self._diagnostics = Diagnostics(
            self, NodeHealth(name, {name: self._statistics}, live=self._flow.name == "live")
        )
        self._ends = StreamEnds(self, lambda topic: None)
        self._instants: Credit | None = None
        self._images: dict[str, Credit] = {}
        self._sound: SoundCredit | None = None
        shift = int(self.declare_parameter("shift_ns", 0).value)
        out, seen, bodies = TOPICS["skeletons"], TOPICS["detections"], TOPICS["bodies"]
        self._readers = int(self.declare_parameter("readers", 0).value)
        kinds = {kind for _, kind in topics.values()}
        self._alone = sound_beside is not None and not sound_beside and kinds == {IMU}
        if self._flow.name == "replay" and self._alone:
            self._instants = Credit(self, self._flow, bodies.name, bodies.message, self._flow.window, shift)
        elif self._flow.name == "replay" and sound_beside is not None:
            awaited = [seen.of(camera) for camera in sound_beside]
            self._sound = SoundCredit(self, self._flow, (out.name, out.message), awaited, shift)
        elif self._flow.name == "replay":
            self._instants = Credit(self, self._flow, out.name, out.message, self._flow.window, shift)
            self._images = {
                key: Credit(self, self._flow, topic, seen.message, self._flow.image_window)
                for key, topic in detections.items()
            }
        self._stopping = threading.Event()
        self._fault: PanopticError | None = None
        self._thread: threading.Thread | None = None

    @property
    def fault(self) -> PanopticError | None:
        """Return the error that ended the source before its end; None if there was none."""
        return self._fault

    @property
    def healthy(self) -> bool:
        """Return False after a fault or a bug."""
        alive = self._thread is None or self._thread.is_alive() or self._diagnostics.finished
        return self._fault is None and alive

    def start(self, outgoing: Iterable[OutgoingMessages]) -> None:
        """Start to publish."""
        self._thread = threading.Thread(target=self._send, args=(iter(outgoing),), daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop publishing and join the thread."""
        self._stopping.set()
        if self._thread is not None:
            self._thread.join(timeout=5.0)

    def note(self, notice: Notice) -> None:
        """Count a notice about the published data."""
        self._statistics.take(notice)

    def refuse(self, error: DataError) -> None:
        """Count and log an item that cannot be published."""
        self._statistics.dropped["bad_message"] += 1
        self.note(Notice("source.bad_message", "warning", str(error)))
        self.get_logger().warning(f"dropped: {error}", throttle_duration_sec=5.0)

    def _send(self, outgoing: Iterator[OutgoingMessages]) -> None:
        with quiet_once(self._stopping.is_set):
            self._run(outgoing)

    def _run(self, outgoing: Iterator[OutgoingMessages]) -> None:
        if self._readers:
            self._wait_for_readers()
        try:
            for item in outgoing:
                if item.ended:
                    self._end(item.ended)
                    continue
                stream = item.messages[0][0]
                credits = [self._images[key] for key, _ in item.messages if key in self._images]
                if self._instants is not None and (self._alone or not item.is_sound):
                    credits.append(self._instants)
                for credit in credits:
                    self._wait(credit, stream)
                if self._sound is not None:
                    self._wait_with_sound(self._sound, item.stamp_ns)
                if self._stopping.is_set():
                    return
                for credit in credits:
                    credit.sent(stream, item.stamp_ns)
                for key, message in item.messages:
                    self._publishers_by_key[key].publish(message)
                    self._sent[key] += 1
                self._statistics.given += 1
                if item.overtaken:
                    self._statistics.dropped["overtaken"] += item.overtaken
        except PanopticError as error:
            self._fault = error
            return
        for key in self._publishers_by_key.keys() - self._ended:
            self._end(key)
        self._diagnostics.finish()

    def _end(self, key: str) -> None:
        """Announce the end of a publisher's topic."""
        self._ended.add(key)
        self._ends.announce(self._publishers_by_key[key].topic_name, self._sent[key])

    def _wait_for_readers(self) -> None:
        """Wait until all readers that need every sample have subscribed.

        Bodies are computed faster than a late reader can catch up. The wait ends with a warning after
        `STALL_S`.
        """
        bodies, began = self.resolve_topic_name(TOPICS["bodies"].name), time.monotonic()
        while not self._stopping.wait(0.05):
            readers = min(p.get_subscription_count() for p in self._publishers_by_key.values())
            there = min(readers, self.count_subscribers(bodies)) >= self._readers
            if there and self.count_publishers(bodies):
                return
            if time.monotonic() - began >= STALL_S:
                self.get_logger().warning(f"fewer than {self._readers} readers have come in {STALL_S:g} s")
                return

    def _wait_with_sound(self, credit: SoundCredit, stamp_ns: int) -> None:
        """Wait until the cameras have caught up, and for readers that are slower than the file."""
        while not self._stopping.is_set() and not credit.wait(stamp_ns, 0.5):
            pass
        if self._statistics.given % PATIENT == PATIENT - 1:
            for publisher in self._publishers_by_key.values():
                publisher.wait_for_all_acked(Duration(seconds=STALL_S))

    def _wait(self, credit: Credit, stream: str) -> None:
        waited = 0.0
        while not self._stopping.is_set() and not credit.wait(stream, 0.5):
            waited += 0.5
            if waited >= STALL_S:
                self._statistics.notices["source.stalled"] += 1
                self.get_logger().warning(f"nothing has come out for {STALL_S:g} s; sending one more")
                return


def camera_topics(camera: str, compressed: bool, depth: bool) -> dict[str, tuple[str, str]]:
    """Return the publishers of a camera node, for `SourceNode`."""
    topics = {
        "image": TOPICS["compressed_image" if compressed else "image"],
        "camera_info": TOPICS["camera_info"],
        **({"depth": TOPICS["depth"]} if depth else {}),
    }
    return {key: (topic.of(camera), topic.message) for key, topic in topics.items()}


def camera_messages(frames: Iterable[Any], camera: Camera, jpeg_quality: int) -> Iterator[OutgoingMessages]:
    """Yield the image, the CameraInfo and the depth map (if any) of every frame.

    Gaps in the frame numbers of a live source are treated as overtaken frames.

    Args:
        jpeg_quality: quality of JPEG images; 0: raw images.
    """
    family, beside = ros_messages(), frames if isinstance(frames, DepthSource) else None
    last, live = None, getattr(frames, "frame_count", None) is None
    for frame in frames:
        overtaken = 0 if last is None or not live else frame.frame_number - last - 1
        last = frame.frame_number
        image = (
            compressed_image_message(frame, family, jpeg_quality)
            if jpeg_quality
            else image_message(frame, family)
        )
        info = camera_info_message(camera, frame.stamp_ns, family)
        depth = (("depth", depth_message(beside.depth_of(frame), family)),) if beside is not None else ()
        yield OutgoingMessages(frame.stamp_ns, (("image", image), ("camera_info", info), *depth), overtaken)


def sound_messages(blocks: Iterable[AudioBlock]) -> Iterator[OutgoingMessages]:
    """Yield a message for every block of an audio source."""
    family = ros_messages()
    for block in blocks:
        yield OutgoingMessages(block.stamp_ns, (("audio", to_message(block, family)),))


def imu_messages(samples: Iterable[ImuSample]) -> Iterator[OutgoingMessages]:
    """Yield a message for every IMU sample, for the publisher of its device."""
    family = ros_messages()
    for sample in samples:
        yield OutgoingMessages(sample.stamp_ns, ((sample.device, to_message(sample, family)),))


def make_camera_node(
    camera: str, rig: Rig, source: Mapping[str, Any], overrides: Mapping[str, Any], jpeg_quality: int
) -> SourceNode:
    """Return a node that publishes the images of one camera.

    Args:
        source: see `capture.open_source`.
        jpeg_quality: 0 = raw images.

    Raises:
        UserError: if the source cannot be opened.
    """
    frames, calibrated = open_source(camera, rig, source)
    detections = TOPICS["detections"].of(camera)
    topics = camera_topics(camera, bool(jpeg_quality), isinstance(frames, DepthSource))
    node = SourceNode(f"camera_{ros_name(camera)}", topics, overrides, {"image": detections})
    node.start(_noted(camera_messages(frames, calibrated, jpeg_quality), frames, node))
    return node


def _noted(
    outgoing: Iterator[OutgoingMessages], source: FrameSource, node: SourceNode
) -> Iterator[OutgoingMessages]:
    """Yield the messages of a source; after the last one, count the notices of the source."""
    yield from outgoing
    for notice in getattr(source, "after", ()):  # live sources never reach a last frame
        node.note(notice)


def make_sound_node(
    sound: Mapping[str, Any], cameras: Sequence[str], overrides: Mapping[str, Any]
) -> SourceNode:
    """Return a node that publishes the audio of a device.

    Args:
        sound: see `capture.sound.open_sound`.
        cameras: cameras that run too.

    Raises:
        UserError: if the source cannot be opened.
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
    """Return a node that publishes IMU samples.

    Args:
        imus: file of samples by device.
        cameras: cameras that run too.
        until_ns: see `imu_samples`.

    Raises:
        UserError: if a file cannot be read.
    """
    topic = TOPICS[IMU_KEY]
    topics = {device: (topic.of(device), topic.message) for device in imus}
    node = SourceNode("imus", topics, overrides, sound_beside=cameras)
    paths = dict.fromkeys(imus.values())
    every = (imu_samples(Path(path), [d for d in imus if imus[d] == path], until_ns) for path in paths)
    node.start(imu_messages(merge(*every, key=lambda sample: sample.stamp_ns)))
    return node


def make_bag_node(streams: Sequence[BagStream], overrides: Mapping[str, Any]) -> SourceNode:
    """Return a node that publishes topics of bags under the names of this graph, merged by timestamps.

    Messages that cannot be decoded are not published, because the middleware would drop them without an
    error.
    """
    names = {stream: TOPICS[stream.key].of(stream.camera) for stream in streams}
    topics = {name: (name, TOPICS[stream.key].message) for stream, name in names.items()}
    images = [stream for stream in streams if stream.key in ("image", "compressed_image")]
    detections = {names[stream]: TOPICS["detections"].of(stream.camera) for stream in images}
    alone = () if all(stream.key == IMU_KEY for stream in streams) else None
    node = SourceNode("bag", topics, overrides, detections, alone)
    node.start(_outgoing(item, names[item.stream]) for item in merged(streams, node.refuse))
    return node


def _outgoing(item: BagMessage | StreamEnd, key: str) -> OutgoingMessages:
    if isinstance(item, StreamEnd):
        return OutgoingMessages(item.place_ns, ended=key)
    return OutgoingMessages(
        item.place_ns, ((key, item.data),), is_sound=item.stream.key in (SOUND_KEY, IMU_KEY)
    )
