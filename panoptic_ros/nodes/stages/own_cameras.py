"""Cameras that a stage node reads itself.

Their images go to the stages without conversion. Messages are made only for subscribers. Each live camera is
read by its own thread. Records of recordings are read when the stages need them.
"""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import ExitStack, closing
from dataclasses import dataclass
from typing import Any

from rclpy.node import Node

from panoptic_ros.capture import Note, open_recording, open_source
from panoptic_ros.domain import DepthFrame, Rig, ViewDetections, ViewFrame
from panoptic_ros.errors import PanopticError
from panoptic_ros.graph.arrivals import ArrivalCounters
from panoptic_ros.graph.build import make_stage, rows_in_use
from panoptic_ros.graph.flow import Flow
from panoptic_ros.graph.host import Host, Key
from panoptic_ros.graph.nodes import NODES
from panoptic_ros.graph.side_by_side import TABLE, ParallelDetection, looked_ahead
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.graph.wiring import Table, Wiring
from panoptic_ros.io.messages import (
    camera_info_message,
    compressed_image_message,
    depth_message,
    image_message,
)
from panoptic_ros.nodes.middleware.family import message_class, ros_messages
from panoptic_ros.nodes.middleware.quality import data_quality
from panoptic_ros.nodes.middleware.streams import STALL_S, Credit
from panoptic_ros.nodes.stages.inputs import Input
from panoptic_ros.params import Config
from panoptic_ros.stage import Stage, StageContext

WAIT_S = 0.1  # s; longest wait for room, before the worker checks for other work


@dataclass(frozen=True)
class OwnCameras:
    """Cameras that a node reads itself.

    Args:
        sources: Descriptions by camera, see `capture.open_source`.
        threads: Number of images that are processed in parallel.
        jpeg_quality: JPEG quality of published images. 0: raw images.
    """

    sources: Mapping[str, Mapping[str, Any]]
    threads: int = 1
    jpeg_quality: int = 0


NONE = OwnCameras({})


class OwnInput(Input):
    """Input whose records are read directly, without messages."""

    def record(self, data: Any) -> Any:
        """Return the record unchanged."""
        return data

    def missing_before(self, record: Any) -> int:
        """Return 0: `came` has already counted the skipped frames."""
        return 0

    def came(self, frame: ViewFrame, latency_ns: int | None) -> int:
        """Count an image; return how many images before it were not read.

        Args:
            latency_ns: Time since its timestamp (live).
        """
        self.arrivals.came(time.monotonic_ns(), None, latency_ns)
        return self.arrivals.numbered(frame.frame_number)


def own_input(node: Node, topic: str, camera: str) -> OwnInput:
    """Return the input of a topic of a camera that the node reads itself."""
    row = TOPICS[topic]
    name = node.resolve_topic_name(row.of(camera))
    arrivals = ArrivalCounters(topic, camera, name, topic == "image", time.monotonic_ns())
    kind = message_class(row.message)
    return OwnInput(topic, topic, camera, name, kind, lambda message, number: message, arrivals)


class ImagePublisher:
    """Publisher of images, camera infos and depth maps of some cameras, for subscribers only."""

    def __init__(self, node: Node, flow: Flow, rig: Rig, own: OwnCameras):
        self._rig, self._quality = rig, own.jpeg_quality
        self._image = "compressed_image" if own.jpeg_quality else "image"
        images = data_quality(flow, images=True)
        self._publishers = {
            (key, camera): node.create_publisher(
                message_class(TOPICS[key].message), TOPICS[key].of(camera), images
            )
            for camera in own.sources
            for key in (self._image, "camera_info", "depth")
        }

    def send(self, record: ViewFrame | DepthFrame) -> None:
        """Publish a record if its topic has a subscriber."""
        family, camera = ros_messages(), record.camera
        if isinstance(record, DepthFrame):
            if self._is_wanted("depth", camera):
                self._publishers["depth", camera].publish(depth_message(record, family))
            return
        if self._is_wanted("camera_info", camera):
            info = camera_info_message(self._rig.camera(camera), record.stamp_ns, family)
            self._publishers["camera_info", camera].publish(info)
        if self._is_wanted(self._image, camera):
            message = (
                compressed_image_message(record, family, self._quality)
                if self._quality
                else image_message(record, family)
            )
            self._publishers[self._image, camera].publish(message)

    def _is_wanted(self, key: str, camera: str) -> bool:
        return self._publishers[key, camera].get_subscription_count() > 0


class LiveCameraReader:
    """Reader of live cameras, with one thread per camera.

    Args:
        sent: Called with each image on that thread, see `ImagePublisher.send`.
        take: Called with (input, image) on that thread.
        failed: Called with the error that ended a camera.
    """

    def __init__(
        self,
        own: OwnCameras,
        rig: Rig,
        inputs: Mapping[str, OwnInput],
        sent: Callable[[Any], None],
        take: Callable[[OwnInput, ViewFrame], None],
        failed: Callable[[PanopticError], None],
    ):
        self._own, self._rig, self._inputs = own, rig, inputs
        self._sent, self._take, self._failed = sent, take, failed
        self._stopping = threading.Event()
        self._sources: dict[str, Any] = {}
        self._threads = [
            threading.Thread(target=self._read, args=(camera,), name=f"camera {camera}", daemon=True)
            for camera in own.sources
        ]
        for thread in self._threads:
            thread.start()

    def _read(self, camera: str) -> None:
        try:
            source, _ = open_source(camera, self._rig, self._own.sources[camera])
            with closing(source):
                self._sources[camera], entry = source, self._inputs[camera]
                for frame in source:
                    if self._stopping.is_set():
                        return
                    self._sent(frame)
                    self._take(entry, frame)
                    entry.arrivals.cpu_ns = time.thread_time_ns()
        except PanopticError as error:
            self._failed(error)

    def close(self) -> None:
        """End the threads and close the devices."""
        self._stopping.set()
        for source in list(self._sources.values()):
            source.close()
        for thread in self._threads:
            thread.join(timeout=5.0)


class RecordingReader:
    """Reader of recordings: it takes records of cameras when the stages need them.

    Args:
        sent: See `ImagePublisher.send`.
        stage: Detection stage that processes images of different cameras in parallel, ahead of the pipeline.
            None: no look-ahead.
        credit: Flow control by the output of the graph, if stages of other processes follow. The cameras then
            advance evenly, because a later stage may wait for any of them. None: records are read in the
            order of the host.
        shifts: By camera, ns: added to its timestamps for a comparison with those of the output.
        note: See `open_recording`.

    Raises:
        UserError: if a source cannot be opened.
    """

    def __init__(
        self,
        own: OwnCameras,
        rig: Rig,
        sent: Callable[[Any], None],
        stage: Stage[Any, ViewDetections] | None,
        credit: Credit | None,
        shifts: Mapping[str, int],
        note: Note,
    ):
        self._stack, self._stopping = ExitStack(), threading.Event()
        self._credit, self._shifts = credit, shifts
        self._waited_s = 0.0
        self._taken: Counter[Key] = Counter()
        self.looks: ParallelDetection | None = None
        try:
            records = open_recording(rig, own.sources, self._stack, note)
            self._records = {key: _told(items, sent) for key, items in records.items()}
            if stage is not None:
                self.looks = self._stack.enter_context(
                    looked_ahead(self._records, stage, own.threads, time.perf_counter_ns)
                )
        except BaseException:
            self._stack.close()
            raise
        self.keys = frozenset(self._records)

    def fetch(self, host: Host, put: Callable[[Key, Any], None], end: Callable[[Key], None]) -> bool:
        """Pass on the record that the stages need next, or the end of its topic.

        Args:
            put: Called with (topic and camera, record).
            end: Called with the topic and camera that have ended.

        Returns:
            whether there is more to do. False: the stages wait for another input, or for none.
        """
        key = None if self._stopping.is_set() else self._next_key(host)
        if key is None:
            return False
        if not self._has_room(key):
            return True
        record = next(self._records[key], None)
        if self._stopping.is_set():
            return False
        self._taken[key] += 1
        if record is None:
            del self._records[key]
            end(key)
            return True
        if self._credit is not None:
            self._credit.sent(key[1], record.stamp_ns + self._shifts.get(key[1], 0))
        put(key, record)
        return True

    def _next_key(self, host: Host) -> Key | None:
        if self._credit is None:
            key = host.waiting_for()
            return key if key in self._records else None
        return min(self._records, key=lambda key: self._taken[key], default=None)

    def _has_room(self, key: Key) -> bool:
        """Return whether one more record may be under way.

        The result is always True after `STALL_S`, because the set of an earlier record may be lost.
        """
        if self._credit is None or self._credit.wait(key[1], WAIT_S):
            self._waited_s = 0.0
            return True
        self._waited_s += WAIT_S
        return self._waited_s >= STALL_S

    def close(self) -> None:
        """End threads and close files."""
        self._stopping.set()
        self._stack.close()


def _told(items: Iterator[Any], sent: Callable[[Any], None]) -> Iterator[Any]:
    for item in items:
        sent(item)
        yield item


class OwnCameraReader:
    """Cameras of a node: recordings or live cameras.

    Args:
        put: Called with (input, record) on the node's worker when the stages need the record (replay).
        end: Called with each topic and camera that has ended.
        note: Called with notices after the last frame of a recording.
    """

    def __init__(
        self,
        node: Node,
        flow: Flow,
        own: OwnCameras | None,
        put: Callable[[OwnInput, Any], None],
        end: Callable[[Key], None],
        note: Note,
    ):
        self._node, self._flow, self._own = node, flow, own or NONE
        self._put, self._end, self._note = put, end, note
        self._inputs: dict[Key, OwnInput] = {}
        self._recordings: RecordingReader | None = None
        self._live: LiveCameraReader | None = None
        threads = self._own.threads
        live = flow.name == "live"
        self.pool: Executor | None = ThreadPoolExecutor(threads) if live and threads > 1 else None

    @property
    def table(self) -> Table:
        """Return the table of stages; if images are processed ahead, detection is replaced."""
        return NODES if self.looks is None else TABLE

    @property
    def looks(self) -> ParallelDetection | None:
        """Return the look-ahead detection (replay); None if images influence each other."""
        return None if self._recordings is None else self._recordings.looks

    def open(
        self,
        rig: Rig,
        configs: Mapping[str, Config],
        context: StageContext,
        used: Collection[str],
        shifts: Mapping[str, int],
    ) -> None:
        """Open recordings (replay).

        Args:
            configs: Configurations of the node's stages.
            used: Ports that a parameter switches on.
            shifts: By camera, ns.

        Raises:
            UserError: if a source cannot be opened.
        """
        if not self._own.sources or self._flow.name == "live":
            return
        ahead = credit = None
        wiring = Wiring(list(configs), table=rows_in_use(used))
        looker = wiring.specs[wiring.readers["image"][0].stage]
        if looker.apart:
            ahead = make_stage(looker.name, configs[looker.name], context)
        if all(spec.apart for spec in wiring.specs):
            out = TOPICS["skeletons"]
            credit = Credit(self._node, self._flow, out.name, out.message, self._flow.window)
        self._recordings = RecordingReader(self._own, rig, self._sent(rig), ahead, credit, shifts, self._note)

    def owners(self, owners: Mapping[str, list[str]]) -> dict[str, list[str]]:
        """Return the owners of each topic.

        A camera that is read here counts only if its recording has the topic.
        """
        if self._recordings is None:
            return dict(owners)
        keys = self._recordings.keys
        return {
            topic: [owner for owner in found if not self.reads(topic, owner) or (topic, owner) in keys]
            for topic, found in owners.items()
        }

    def reads(self, topic: str, owner: str) -> bool:
        """Return whether this node reads a topic of a camera itself.

        A device with the name of a camera may have audio or IMU topics, which are not read here.
        """
        return TOPICS[topic].scope == "camera" and owner in self._own.sources

    def inputs(self, present: Sequence[Key]) -> list[OwnInput]:
        """Make and return the inputs for the keys (topic, owner) in `present` that are read here."""
        self._inputs = {key: own_input(self._node, *key) for key in present if self.reads(*key)}
        return list(self._inputs.values())

    def start(
        self, rig: Rig, take: Callable[[OwnInput, ViewFrame], None], failed: Callable[[PanopticError], None]
    ) -> None:
        """Start to read live cameras; see `LiveCameraReader`."""
        if self._own.sources and self._flow.name == "live":
            inputs = {camera: self._inputs["image", camera] for camera in self._own.sources}
            self._live = LiveCameraReader(self._own, rig, inputs, self._sent(rig), take, failed)

    def fetch(self, host: Host | None) -> bool:
        """Pass on the next record that the stages need from a recording; return whether more is to do."""
        if self._recordings is None or host is None:
            return False
        return self._recordings.fetch(host, self._came, self._end)

    def duration_ns(self, stage: str, step_ns: int) -> int:
        """Return the duration (ns) of a step, or of the look-ahead detection that replaced it."""
        ahead = self.looks is not None and self.table[stage] is not NODES[stage]
        return self.looks.duration_ns if self.looks is not None and ahead else step_ns

    def close(self) -> None:
        """End all threads; close files and devices."""
        for cameras in (self._recordings, self._live):
            if cameras is not None:
                cameras.close()
        if self.pool is not None:
            self.pool.shutdown(wait=False, cancel_futures=True)

    def _sent(self, rig: Rig) -> Callable[[Any], None]:
        return ImagePublisher(self._node, self._flow, rig, self._own).send

    def _came(self, key: Key, record: Any) -> None:
        entry = self._inputs[key]
        if isinstance(record, ViewFrame):
            entry.came(record, None)
        self._put(entry, record)
