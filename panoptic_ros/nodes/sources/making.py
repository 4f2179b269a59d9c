"""Making source nodes from a plain description, as it stands in a launcher's file or in parameters.

Sources: cameras (devices and files) and bags, publishing in the flow that was asked for.
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
from panoptic_ros.graph.health import Health
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
class Outgoing:
    """Messages to send together: (publisher's key, message); frames that were overtaken before them.
    Or the end of a publisher.

    Args:
        is_sound: it goes ahead of what it is beside, and waits for nothing of its own.
        ended: key of a publisher that has no more to send; there are no messages then.
    """

    stamp_ns: int
    messages: tuple[tuple[str, Any], ...] = ()
    overtaken: int = 0
    is_sound: bool = False
    ended: str = ""


class SourceNode(Node):
    """Publishes what an iterator gives, from a thread of its own.

    Parameters: `flow` and `replay_window` as in `StageNode`; `shift_ns`: what is added to stamps in replay,
    so that they can be compared with those of skeletons; `readers`: of IMUs alone, for how many readers of
    each topic and of bodies it waits.

    Args:
        topics: key -> (topic, message type) of the publishers; the first one is the one that counts.
        detections: for publishers of images, by key: the topic whose messages show that an image has
            been dealt with.
        sound_beside: of a source of sound or IMUs: the cameras beside it; IMUs that have none wait for bodies
            instead. None: it sends images or detections.
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
            self, Health(name, {name: self._statistics}, live=self._flow.name == "live")
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
        """What ended the source before its end, if anything did."""
        return self._fault

    @property
    def healthy(self) -> bool:
        """False after a fault, or a bug."""
        alive = self._thread is None or self._thread.is_alive() or self._diagnostics.finished
        return self._fault is None and alive

    def start(self, outgoing: Iterable[Outgoing]) -> None:
        """Begin to send."""
        self._thread = threading.Thread(target=self._send, args=(iter(outgoing),), daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop sending."""
        self._stopping.set()
        if self._thread is not None:
            self._thread.join(timeout=5.0)

    def note(self, notice: Notice) -> None:
        """Count something that is known of what is sent."""
        self._statistics.take(notice)

    def refuse(self, error: DataError) -> None:
        """Count something that cannot be sent."""
        self._statistics.dropped["bad_message"] += 1
        self.note(Notice("source.bad_message", "warning", str(error)))
        self.get_logger().warning(f"dropped: {error}", throttle_duration_sec=5.0)

    def _send(self, outgoing: Iterator[Outgoing]) -> None:
        with quiet_once(self._stopping.is_set):
            self._run(outgoing)

    def _run(self, outgoing: Iterator[Outgoing]) -> None:
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
        """Tell that no more comes of a publisher."""
        self._ended.add(key)
        self._ends.announce(self._publishers_by_key[key].topic_name, self._sent[key])

    def _wait_for_readers(self) -> None:
        """Wait until all are there who want every sample: bodies of them come faster than late readers do."""
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
        """Wait for the cameras, and for readers that are slower than the file."""
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
    """Publishers of a camera node, for `SourceNode`."""
    topics = {
        "image": TOPICS["compressed_image" if compressed else "image"],
        "camera_info": TOPICS["camera_info"],
        **({"depth": TOPICS["depth"]} if depth else {}),
    }
    return {key: (topic.of(camera), topic.message) for key, topic in topics.items()}


def camera_messages(frames: Iterable[Any], camera: Camera, jpeg_quality: int) -> Iterator[Outgoing]:
    """Image (JPEG if a quality is given, else raw), CameraInfo and depth map, if any, of every frame.

    Numbers that are missing are frames of a live source that were overtaken.
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
        yield Outgoing(frame.stamp_ns, (("image", image), ("camera_info", info), *depth), overtaken)


def sound_messages(blocks: Iterable[AudioBlock]) -> Iterator[Outgoing]:
    """Every block of a source of sound."""
    family = ros_messages()
    for block in blocks:
        yield Outgoing(block.stamp_ns, (("audio", to_message(block, family)),))


def imu_messages(samples: Iterable[ImuSample]) -> Iterator[Outgoing]:
    """Every sample of IMUs, to the publisher of its device."""
    family = ros_messages()
    for sample in samples:
        yield Outgoing(sample.stamp_ns, ((sample.device, to_message(sample, family)),))


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
