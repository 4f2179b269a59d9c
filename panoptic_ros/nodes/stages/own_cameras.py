"""Cameras that a node reads itself: their images go to its stages as they are.

Messages are made of them only for those who subscribe.

Live cameras that a node reads itself, each in a thread of its own.

Recordings that a node reads itself: each record is taken when the stages want it.

What a node of stages does about the cameras that it reads itself.
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
from panoptic_ros.graph.arrivals import Arrivals
from panoptic_ros.graph.build import make_stage, rows_in_use
from panoptic_ros.graph.flow import Flow
from panoptic_ros.graph.host import Host, Key
from panoptic_ros.graph.nodes import NODES
from panoptic_ros.graph.side_by_side import TABLE, SideBySide, looked_ahead
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

WAIT_S = 0.1  # for room; then the node looks whether there is something else to do


@dataclass(frozen=True)
class OwnCameras:
    """The cameras that a node reads itself.

    Args:
        sources: descriptions by camera, see `capture.open_source`.
        threads: images that are worked on at a time.
        jpeg_quality: of images that are sent; 0: as they are.
    """

    sources: Mapping[str, Mapping[str, Any]]
    threads: int = 1
    jpeg_quality: int = 0


NONE = OwnCameras({})


class OwnInput(Input):
    """An input whose records come as they are."""

    def record(self, data: Any) -> Any:
        """The record."""
        return data

    def missing_before(self, record: Any) -> int:
        """None: `came` has counted them."""
        return 0

    def came(self, frame: ViewFrame, latency_ns: int | None) -> int:
        """An image was read, so long after its stamp (live); how many before it nobody read."""
        self.arrivals.came(time.monotonic_ns(), None, latency_ns)
        return self.arrivals.numbered(frame.frame_number)


def own_input(node: Node, topic: str, camera: str) -> OwnInput:
    """The input of a topic of a camera that the node reads itself."""
    row = TOPICS[topic]
    name = node.resolve_topic_name(row.of(camera))
    arrivals = Arrivals(topic, camera, name, topic == "image", time.monotonic_ns())
    kind = message_class(row.message)
    return OwnInput(topic, topic, camera, name, kind, lambda message, number: message, arrivals)


class ImagesSent:
    """Sends images, camera infos and depth maps of some cameras to those who subscribe."""

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
        """Send a record, if somebody subscribes."""
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


class LiveCameras:
    """Reads live cameras, each in a thread of its own.

    Args:
        take: called with (input, image), on that thread.
        failed: called with what ended a camera.
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


class RecordingsRead:
    """The records of cameras of a recording, taken when the stages want them.

    Args:
        sent: see `ImagesSent.send`.
        stage: looks ahead at the images of different cameras side by side; None: nobody does.
        credit: of what comes out of the graph, where stages of another process follow. Cameras then go on
            side by side, as a stage further down may wait for any of them; without, in the order of the host.
        shifts: by camera, ns: from its stamps to those of what comes out.
        note: see `open_recording`.

    Raises:
        UserError: as the opening of sources.
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
        self.looks: SideBySide | None = None
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
        """Hand over the record that the stages want next, or tell the end of them.

        Args:
            put: takes a record and its topic and camera. end: told of those of which no more comes.

        Returns:
            whether there is more to do; False: the stages want something else, or nothing.
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
        """Whether one more record may be under way; after a long time in any case, as its set may be lost."""
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


class OwnReading:
    """Cameras of a node: recordings, or live.

    Args:
        put: takes (topic and camera, record) when the stages want it (replay), on the node's worker.
        end: told of the topics and cameras of which no more comes.
        note: takes what is known after the last frame of a recording.
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
        self._recordings: RecordingsRead | None = None
        self._live: LiveCameras | None = None
        threads = self._own.threads
        live = flow.name == "live"
        self.pool: Executor | None = ThreadPoolExecutor(threads) if live and threads > 1 else None

    @property
    def table(self) -> Table:
        """The rows of stages, with what was looked at ahead in the place of detection."""
        return NODES if self.looks is None else TABLE

    @property
    def looks(self) -> SideBySide | None:
        """What looks ahead at images (replay), if they do not influence each other."""
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
            configs: of the node's stages. used: ports that a parameter switches on. shifts: by camera, ns.

        Raises:
            UserError: as the opening of sources.
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
        self._recordings = RecordingsRead(self._own, rig, self._sent(rig), ahead, credit, shifts, self._note)

    def owners(self, owners: Mapping[str, list[str]]) -> dict[str, list[str]]:
        """Who gives each topic to the stages: of cameras that are read here, what their recordings hold."""
        if self._recordings is None:
            return dict(owners)
        keys = self._recordings.keys
        return {
            topic: [owner for owner in found if not self.reads(topic, owner) or (topic, owner) in keys]
            for topic, found in owners.items()
        }

    def reads(self, topic: str, owner: str) -> bool:
        """Whether what a camera gives on a topic is read here; a device of its name may hear or move."""
        return TOPICS[topic].scope == "camera" and owner in self._own.sources

    def inputs(self, present: Sequence[Key]) -> list[OwnInput]:
        """The inputs of those of the topics and owners that are read here."""
        self._inputs = {key: own_input(self._node, *key) for key in present if self.reads(*key)}
        return list(self._inputs.values())

    def start(
        self, rig: Rig, take: Callable[[OwnInput, ViewFrame], None], failed: Callable[[PanopticError], None]
    ) -> None:
        """Begin to read live cameras; see `LiveCameras`."""
        if self._own.sources and self._flow.name == "live":
            inputs = {camera: self._inputs["image", camera] for camera in self._own.sources}
            self._live = LiveCameras(self._own, rig, inputs, self._sent(rig), take, failed)

    def fetch(self, host: Host | None) -> bool:
        """Hand over what the stages want next of a recording; whether there is more to do."""
        if self._recordings is None or host is None:
            return False
        return self._recordings.fetch(host, self._came, self._end)

    def duration_ns(self, stage: str, step_ns: int) -> int:
        """Of a step of a stage: where images were looked at ahead, of that look."""
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
        return ImagesSent(self._node, self._flow, rig, self._own).send

    def _came(self, key: Key, record: Any) -> None:
        entry = self._inputs[key]
        if isinstance(record, ViewFrame):
            entry.came(record, None)
        self._put(entry, record)
