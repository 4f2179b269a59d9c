"""The one adapter round every stage: subscribe, convert, step, publish, report."""
from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter

from panoptic_ros.domain import ClockModel, EndOfStream, Rig, SkeletonModel
from panoptic_ros.errors import DataError, PanopticError
from panoptic_ros.graph.build import make_stage, resolve
from panoptic_ros.graph.counters import StageStatistics
from panoptic_ros.graph.depth_pairing import Pair
from panoptic_ros.graph.entrance import check_view
from panoptic_ros.graph.flow import WINDOW, live_defaults, make_flow
from panoptic_ros.graph.nodes import NODES
from panoptic_ros.graph.queues import InOrder, NewestInstant, Waiting
from panoptic_ros.graph.topics import TOPICS, ros_name
from panoptic_ros.io.messages import frame_from_message, from_message, stamp_of, to_message
from panoptic_ros.nodes.audio_common import TOPIC as AUDIO_COMMON_TOPIC
from panoptic_ros.nodes.audio_common import AudioDataReader, audio_common_class
from panoptic_ros.nodes.clock_reports import ClockReports
from panoptic_ros.nodes.depth_input import DepthInput
from panoptic_ros.nodes.diagnostics import Diagnostics
from panoptic_ros.nodes.facts import Facts
from panoptic_ros.nodes.family import message_class, ros_messages
from panoptic_ros.nodes.news import News
from panoptic_ros.nodes.parameters import declare_config
from panoptic_ros.nodes.quality import CLOCKS, PATIENT, data_quality
from panoptic_ros.nodes.streams import StreamEnds
from panoptic_ros.nodes.worker import Worker
from panoptic_ros.stage import StageContext

Extras = Callable[[Node, SkeletonModel], Mapping[str, Any]]  # what a stage needs beyond the context


@dataclass
class _Input:
    """One subscribed topic: whose it is, what it carries, and how much came."""

    topic: str  # full name
    scope: str  # camera or device, "" for topics of the graph
    record: str
    count: int = 0
    last_number: int | None = None
    over: bool = False
    optional: bool = False  # latched: may never come, and has no end


class StageNode(Node):
    """A node for one stage of `graph.nodes.NODES`.

    Waits for the latched rig and skeleton model, then builds the stage. A message with bad content is
    counted, reported on /diagnostics and dropped; any other error ends the node (see `fault`).

    Parameters: those of the stage's configuration; `flow` (live or replay), `window` (see
    `graph.flow`), `cameras` (only these; empty: all of the rig), `depths` and
    `compressed_depths` (detection, see `DepthInput`), `devices` (audio devices), `audio_rate` and
    `audio_channels` (of audio_common_msgs, which do not tell).
    """

    def __init__(
        self,
        stage: str,
        overrides: Mapping[str, Any] = {},
        extras: Extras | None = None,
        name: str | None = None,
    ):
        super().__init__(
            name or stage,
            parameter_overrides=[Parameter(key, value=value) for key, value in overrides.items()],
        )
        self._spec = NODES[stage]
        self._extras = extras
        self._flow = make_flow(
            self.declare_parameter("flow", "live").value, self.declare_parameter("window", WINDOW).value
        )
        self._cameras = self._names("cameras")
        self._devices = self._names("devices")
        self._compressed = bool(self.declare_parameter("compressed", False).value)
        self._config = declare_config(
            self, resolve(self._spec.config), live_defaults(self._flow.name, stage)
        )
        self._statistics = StageStatistics()
        self._news = News(self.get_logger(), self._statistics)
        self._diagnostics = Diagnostics(self, self._statistics)
        self._clocks = ClockReports(self) if "clock_models" in self._spec.takes else None
        if self._clocks is not None:
            self._diagnostics.more = self._clocks.statuses
        self._audio: dict[str, AudioDataReader] = {}
        if "audio" in self._spec.takes:
            rate = self.declare_parameter("audio_rate", 16000).value
            channels = self.declare_parameter("audio_channels", 1).value
            self._audio = {device: AudioDataReader(device, rate, channels) for device in self._devices}
        self._stage: Any = None
        self._inputs: dict[str, _Input] = {}
        self._outputs: dict[str, Any] = {}
        self._sent: dict[str, int] = {}
        self._fault: PanopticError | None = None
        self._worker = Worker(self._work, self._dropped)
        self._diagnostics.busy_s = lambda: self._worker.busy_s
        self._depths = DepthInput(self, self._flow, self._put_pair) if "depth" in self._spec.takes else None
        self._ends = StreamEnds(self, self._topic_over)
        self._facts = Facts(self, self._begin, self._refuse)

    def _names(self, parameter: str) -> list[str]:
        return list(self.declare_parameter(parameter, Parameter.Type.STRING_ARRAY).value or [])

    @property
    def fault(self) -> PanopticError | None:
        """What ended this node, if anything did."""
        return self._fault or self._worker.fault

    @property
    def healthy(self) -> bool:
        """False after a fault or a bug."""
        return self._fault is None and self._worker.alive

    def close(self) -> None:
        """Stop the worker."""
        self._worker.stop()

    # -------------------------------------------------------------- start

    def _begin(self, rig: Rig, skeleton: SkeletonModel) -> None:
        try:
            self._start(rig, skeleton)
        except PanopticError as error:
            self._fault = error

    def _refuse(self, error: PanopticError) -> None:
        self._statistics.dropped["bad_message"] += 1
        self.get_logger().warning(f"dropped: {error}", throttle_duration_sec=5.0)

    def _start(self, rig: Rig, skeleton: SkeletonModel) -> None:
        extras = self._extras(self, skeleton) if self._extras else {}
        used = rig.subset(self._cameras) if self._cameras else rig
        self._stage = make_stage(self._spec.name, self._config, StageContext(used, skeleton, extras))
        self._worker.start(self._queue(used))
        gives = TOPICS[self._spec.gives]
        for scope in self._scopes(gives.scope, used):
            self._outputs[scope] = self.create_publisher(
                message_class(gives.message),
                gives.of(scope),
                CLOCKS if gives.latched else data_quality(self._flow, sound=gives.scope == "device"),
            )
        if self._depths is not None:
            self._depths.listen(used.names, self._ends)
        for key in self._spec.takes:
            if key == "depth":
                continue
            topic = TOPICS["compressed_image" if key == "image" and self._compressed else key]
            for scope in self._scopes(topic.scope, used):
                name = topic.of(scope)
                subscription = self.create_subscription(
                    message_class(topic.message),
                    name,
                    self._receiver(scope, topic.record),
                    CLOCKS if topic.latched
                    else data_quality(self._flow, key == "image", topic.scope == "device"),
                )
                full = subscription.topic_name
                self._inputs[full] = _Input(full, scope, topic.record, optional=topic.latched)
                if not topic.latched:
                    self._ends.watch(full)
                if key == "audio":
                    self._listen_to_audio_common(scope)
        self.get_logger().info(f"ready: {len(self._inputs)} topics in, {len(self._outputs)} out")

    def _listen_to_audio_common(self, device: str) -> None:
        """The other message that carries sound, where its package is installed."""
        kind = audio_common_class()
        if kind is not None:
            quality = data_quality(self._flow, sound=True)
            topic = AUDIO_COMMON_TOPIC.format(device=ros_name(device))
            self.create_subscription(kind, topic, self._receiver(device, "AudioBlock"), quality)

    def _queue(self, rig: Rig) -> Waiting:
        """Live images wait as instants; everything else in order."""
        if self._flow.queue_limit is not None and "image" in self._spec.takes:
            return NewestInstant(rig.names)
        patient = self._spec.name == "offsets" or TOPICS[self._spec.takes[0]].scope == "device"
        if self._flow.queue_limit is not None and patient:
            return InOrder(PATIENT)  # busy for a second after every block; of sound every block counts
        return InOrder(self._flow.queue_limit)

    def _scopes(self, scope: str, rig: Rig) -> list[str]:
        return {"camera": list(rig.names), "device": self._devices, "graph": [""]}[scope]

    # --------------------------------------------------------------- work

    def _receiver(self, scope: str, record: str) -> Callable[[Any], None]:
        """Enqueues; what comes of many devices on one topic does not push each other out."""

        def receive(message: Any) -> None:
            if self._depths is not None:
                self._depths.take_image(scope, message)
                return
            key = f"{record} of {message.header.frame_id}" if record == "ClockModel" else scope
            self._worker.put(key, stamp_of(message.header), (scope, message))

        return receive

    def _put_pair(self, pair: Pair) -> None:
        self._worker.put(pair.camera, pair.stamp_ns, (pair.camera, pair))

    def _topic_over(self, topic: str) -> None:
        if self._depths is None or not self._depths.over(topic):
            self._worker.note((topic, None))

    def _dropped(self, count: int) -> None:
        self._statistics.dropped["queue_full"] += count

    def _work(self, item: tuple[str, Any]) -> None:
        """Process one message, or the end of a topic (message None)."""
        key, message = item
        if message is None:
            self._end(self._inputs[key])
            return
        source = next(entry for entry in self._inputs.values() if entry.scope == key)
        start = time.perf_counter_ns()
        try:
            record = self._record(source, message)
            if self._clocks is not None and isinstance(record, ClockModel):
                self._clocks.take(record)
            result = self._stage.step(record)
            self._count_gap(source, record)
        except DataError as error:
            self._refuse(error)
        else:
            self._statistics.taken += 1
            self._publish(result)
            self._statistics.add_duration(time.perf_counter_ns() - start)
        finally:
            source.count += 1
            self._ends.taken(source.topic)

    def _record(self, source: _Input, message: Any) -> Any:
        if source.record == "ViewFrame":
            return self._checked(
                frame_from_message(message.image, source.scope, source.count, message.depth), source.scope
            )
        if source.record == "ViewDetections":
            return self._checked(from_message(message, source.record), source.scope)
        if hasattr(message, "audio"):
            return self._audio[source.scope].block(message)
        return from_message(message, source.record)

    def _checked(self, view: Any, camera: str) -> Any:
        check_view(view, camera, self._facts.rig, self._facts.skeleton)
        return view

    def _count_gap(self, source: _Input, record: Any) -> None:
        """Numbers that are left out are messages that the middleware dropped, or the node before."""
        number = getattr(record, "index", getattr(record, "frame_number", None))
        if number is not None:
            if source.last_number is not None and number > source.last_number + 1:
                self._statistics.dropped["never_came"] += number - source.last_number - 1
            source.last_number = number

    def _publish(self, result: Any) -> None:
        for notice in result.notices:
            self._news.tell(notice)
        frame_id = self._facts.rig.frame_id
        for record in result.outputs:
            scope = "" if "" in self._outputs else getattr(record, "camera", None) or record.device
            publisher = self._outputs[scope]
            publisher.publish(to_message(record, ros_messages(), frame_id))
            self._sent[scope] = self._sent.get(scope, 0) + 1
            self._statistics.given += 1

    # ---------------------------------------------------------------- end

    def _end(self, source: _Input) -> None:
        """A topic is over (replay)."""
        source.over = True
        if self._spec.name == "sync":
            self._publish(self._stage.step(EndOfStream(source.scope)))
        if source.scope in self._outputs and source.scope:
            self._announce(source.scope)
        if all(entry.over for entry in self._inputs.values() if not entry.optional):
            self._publish(self._stage.flush())
            if "" in self._outputs:
                self._announce("")
            self._diagnostics.finished = True
            self._diagnostics.publish()

    def _announce(self, scope: str) -> None:
        self._ends.announce(self._outputs[scope].topic_name, self._sent.get(scope, 0))
