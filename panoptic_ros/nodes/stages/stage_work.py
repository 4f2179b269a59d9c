"""Work of a stage node: messages in, one step after the other, messages out.

Live records reach the stages as they arrive, replayed records in the order of their places. Messages are
published only where they are wanted. A live node is paused and resumed by a service instead of a ROS
lifecycle, so it keeps its state.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple, Protocol

from rclpy.node import Node

from panoptic_ros.domain import Rig, ViewFrame
from panoptic_ros.errors import DataError, PanopticError
from panoptic_ros.graph.continuity import AlignedTimes
from panoptic_ros.graph.flow import Flow
from panoptic_ros.graph.health import NodeHealth
from panoptic_ros.graph.host import Host, Key, lanes_of
from panoptic_ros.graph.nodes import NODES
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.graph.queues import Companions, QueuedMessage, queue_for
from panoptic_ros.graph.topics import TOPICS, owner_of
from panoptic_ros.graph.under_way import ParallelPipeline
from panoptic_ros.io.messages import to_message
from panoptic_ros.io.messages.records import OriginalMessages
from panoptic_ros.nodes.health.diagnostics import Diagnostics
from panoptic_ros.nodes.health.reports import RecordReport
from panoptic_ros.nodes.health.tally import Tally
from panoptic_ros.nodes.middleware.family import message_class, ros_messages, service_class
from panoptic_ros.nodes.middleware.quality import CLOCKS, data_quality
from panoptic_ros.nodes.middleware.read_together import GatheringNode
from panoptic_ros.nodes.middleware.runtime import now_of
from panoptic_ros.nodes.middleware.streams import StreamEnds
from panoptic_ros.nodes.middleware.worker import Worker
from panoptic_ros.nodes.stages.facts import FactsSubscriber
from panoptic_ros.nodes.stages.inputs import Input, InputChoice, MessageValidator, subscribe
from panoptic_ros.nodes.stages.instant_service import InstantService
from panoptic_ros.nodes.stages.kept_states import StateExchange
from panoptic_ros.nodes.stages.own_cameras import OwnCameraReader, OwnInput
from panoptic_ros.params import Config
from panoptic_ros.stage import StageContext


class Outputs:
    """Publishers of topics.

    Args:
        leaving: Keys of topics that are always published. Others are published only while they have a
            subscriber.
        ends: Announces the ends of topics (replay).

    Attributes:
        origins: Messages that records were decoded from. A published message that contains such a record
            reuses its original message.
    """

    def __init__(self, node: Node, flow: Flow, leaving: Collection[str], ends: StreamEnds):
        self._node, self._flow, self._leaving, self._ends = node, flow, frozenset(leaving), ends
        self.origins = OriginalMessages(TOPICS[topic].record for topic in leaving)
        self._messages = replace(ros_messages(), origin=self.origins.of)
        self._publishers: dict[tuple[str, str], Any] = {}
        self._sent: dict[tuple[str, str], int] = {}

    def open(self, topic: str, owner: str) -> None:
        """Make the publisher of a topic of a camera or device."""
        row = TOPICS[topic]
        quality = CLOCKS if row.latched else data_quality(self._flow, sound=row.scope == "device")
        self._publishers[topic, owner] = self._node.create_publisher(
            message_class(row.message), row.of(owner), quality
        )

    def __len__(self) -> int:
        return len(self._publishers)

    def publish(self, topic: str, record: Any, rig: Rig) -> None:
        """Publish a record if it leaves the process or its topic has a subscriber."""
        key = topic, owner_of(topic, record)
        publisher = self._publishers[key]
        if topic not in self._leaving and not publisher.get_subscription_count():
            return
        publisher.publish(to_message(record, self._messages, rig.frame_id))
        self._sent[key] = self._sent.get(key, 0) + 1

    def end(self, topic: str, owner: str | None = None) -> None:
        """Announce the end of a topic.

        Args:
            owner: Camera or device. None: all owners whose end was not announced yet.
        """
        for key in [key for key in self._publishers if key[0] == topic and owner in (None, key[1])]:
            if self._sent.get(key, 0) >= 0:
                self._ends.announce(self._publishers[key].topic_name, self._sent.get(key, 0))
                self._sent[key] = -1


SERVICE = "std_srvs/srv/SetBool"


class PauseService:
    """Service `~/pause` of a node: `true` discards all further messages, `false` resumes.

    Identities, noise tables and clocks are kept. After a pause, people are re-identified at their new
    positions.
    """

    def __init__(self, node: Node):
        self._node = node
        self.paused = False
        self.left_out = 0  # messages discarded since the pause began
        self._service = node.create_service(service_class(SERVICE), "~/pause", self._asked)

    def leaves_out(self) -> bool:
        """Return whether to discard an arrived message, and count it if so."""
        self.left_out += self.paused
        return self.paused

    def _asked(self, request: Any, response: Any) -> Any:
        response.success = self.paused != request.data
        if request.data and not self.paused:
            self.left_out = 0
            response.message = "paused"
        elif request.data:
            response.message = "paused already"
        elif self.paused:
            response.message = f"resumed; {self.left_out} messages were left out"
        else:
            response.message = "was not paused"
        self.paused = bool(request.data)
        if response.success:
            self._node.get_logger().info(response.message)
        return response


class ArrivedRecord(NamedTuple):
    """Record that has arrived on a topic of a camera or device.

    Args:
        record: None if the message was unusable.
        came_ns: Time of arrival on the monotonic clock.
    """

    topic: str
    owner: str
    stamp_ns: int
    record: Any | None
    came_ns: int


class Delivery(Protocol):
    """Interface that passes records to the stages.

    All methods are called on the node's worker thread.
    """

    def take(self, arrivals: Sequence[ArrivedRecord]) -> None:
        """Process records; they are of one instant if that is possible."""

    def wait(self) -> None:
        """Wait until no stage is busy."""


class LiveDelivery:
    """Delivery of records in the order of their arrival.

    Args:
        now_ns: Returns the time of the clock that cameras should use for timestamps.
    """

    def __init__(self, under_way: ParallelPipeline, now_ns: Callable[[], int] = time.time_ns):
        self._under_way, self._now_ns = under_way, now_ns

    def take(self, arrivals: Sequence[ArrivedRecord]) -> None:
        came_ns = arrivals[0].came_ns
        waited_ns = time.monotonic_ns() - came_ns
        self._under_way.waited(waited_ns)
        self._under_way.arrived(came_ns, self._now_ns() - waited_ns)
        self._under_way.begin([(one.topic, one.record) for one in arrivals if one.record is not None])

    def wait(self) -> None:
        self._under_way.wait()


class ReplayDelivery:
    """Delivery of records in the order of their places, independent of their arrival (see `graph.host`).

    Args:
        on_over: Called when all topics have ended and all records are processed. It may be called repeatedly.
    """

    def __init__(self, host: Host, on_over: Callable[[], None]):
        self.host, self._on_over = host, on_over

    def take(self, arrivals: Sequence[ArrivedRecord]) -> None:
        for one in arrivals:
            self.host.put(one.topic, one.owner, one.stamp_ns, one.record)
        self._advance()

    def wait(self) -> None:
        """Do nothing: records are processed one at a time."""

    def end(self, key: Key) -> None:
        """End a topic of a camera or device."""
        self.host.end(*key)
        self._advance()

    def _advance(self) -> None:
        self.host.advance()
        if self.host.over:
            self._on_over()


@dataclass(frozen=True)
class NodeParts:
    """Objects of a node that exist before rig and skeleton model arrive.

    Args:
        reports: Receivers of records for /diagnostics, by record class name.
        kept, pausing: None in replay.
    """

    node: GatheringNode
    flow: Flow
    choice: InputChoice
    reading: OwnCameraReader
    worker: Worker
    tally: Tally
    facts: FactsSubscriber
    health: NodeHealth
    diagnostics: Diagnostics
    reports: Mapping[str, RecordReport]
    ends: StreamEnds
    kept: StateExchange | None
    pausing: PauseService | None


@dataclass(frozen=True)
class StageSelection:
    """Stages of a node and their configurations, as selected by its parameters.

    Args:
        configs: Configurations by stage.
        everywhere: All stages that run in the graph.
        used: Ports that parameters switch on.
        shifts: See `StageNode`.
    """

    configs: Mapping[str, Config]
    everywhere: Sequence[str]
    used: Collection[str]
    shifts: Mapping[str, int]


class StageWork:
    """Main loop of a node: takes messages, runs the stages and publishes their output.

    Everything except the start, `_receive` and `_take_own` runs on the node's worker.

    Raises:
        PanopticError: if a stage cannot be made from its configuration.
    """

    def __init__(self, around: NodeParts, chosen: StageSelection, context: StageContext):
        self._around, self._chosen, self._rig = around, chosen, context.rig
        self._live = around.flow.name == "live"
        self._logger = around.node.get_logger()
        self._inputs: dict[str, Input] = {}  # by full name
        self._companions = Companions((), ())
        self._services: dict[str, InstantService] = {}  # by stage
        self._times = AlignedTimes(context.rig.names)
        # Timestamps of named clocks agree only after sync has corrected them.
        named = any(camera.clock for camera in context.rig.cameras) or "clocks" in chosen.everywhere
        self._has_common_clock = not named
        reading, tally = around.reading, around.tally
        reading.open(context.rig, chosen.configs, context, chosen.used, chosen.shifts)
        self.pipeline = Pipeline(
            chosen.configs,
            replace(context, extras={**context.extras, "looks": reading.looks}),
            list(chosen.configs),
            on_record=self._gave,
            on_notice=tally.tell,
            on_refused=self._refused,
            on_end=self._owner_over,
            on_step=self._stepped,
            on_cpu=tally.used,
            clock=time.monotonic_ns,
            cpu_clock=time.thread_time_ns,
            everywhere=chosen.everywhere,
            table=reading.table,
            used=chosen.used,
        )
        self._entrance = MessageValidator(around.facts, tally, around.reports, self.pipeline.wiring)
        self._outputs = self._open_outputs()
        owners = reading.owners(
            {port.topic: around.choice.owners(port.topic, self._rig) for port in self.pipeline.wiring.inputs}
        )
        self._present = [(topic, owner) for topic, found in owners.items() for owner in found]
        under_way = ParallelPipeline(self.pipeline, reading.pool, around.worker.urge)
        live = LiveDelivery(under_way, self._now_ns)
        self._delivery: Delivery = live if self._live else self._in_order(owners)
        self._full = (lambda: under_way.full) if self._live else (lambda: False)

    # -------------------------------------------------------------- start

    def start(self, states: Mapping[str, bytes], failed: Callable[[PanopticError], None]) -> None:
        """Start to process messages.

        Args:
            states: Kept states by stage.
            failed: Called with the error that ended a live camera of the node.
        """
        around, present, ports = self._around, self._present, self.pipeline.wiring.inputs
        self._take_over(states)
        for own in around.reading.inputs(present):  # before the worker may fetch their records
            around.health.add(own.arrivals, self._entrance.taker(own.topic))
        if self._live:
            self._companions = Companions([port for port in ports if port.patience_ns], present)
        around.worker.start(queue_for(self.pipeline.wiring, around.flow, present, self._full))
        self._open_services()
        self._subscribe()
        around.reading.start(self._rig, self._take_own, failed)
        gc.freeze()  # existing objects stay alive; scanning them takes longer than a camera period
        self._logger.info(f"ready: {len(self._inputs)} topics in, {len(self._outputs)} out")

    def _open_outputs(self) -> Outputs:
        around, wiring = self._around, self.pipeline.wiring
        final = {topic for topic in wiring.given if TOPICS[topic].latched or not _is_taken(topic)}
        outputs = Outputs(around.node, around.flow, wiring.leaving | final, around.ends)
        for topic in sorted(wiring.given):
            for owner in around.choice.owners(topic, self._rig):
                outputs.open(topic, owner)
        return outputs

    def _open_services(self) -> None:
        """Open the services of stages that give records of requested instants."""
        for spec in self.pipeline.wiring.specs:
            if spec.service:
                self._services[spec.name] = InstantService(
                    self._around.node,
                    spec.service,
                    TOPICS[spec.outputs[0]].of(),
                    partial(self.pipeline.stage, spec.name),
                    self._around.worker.urge,
                    lambda: self._around.facts.rig.frame_id,
                )

    def close(self) -> None:
        """Stop answering requests."""
        for service in self._services.values():
            service.close()

    def _in_order(self, owners: Mapping[str, Sequence[str]]) -> ReplayDelivery:
        chosen, outputs, clock_of = self._chosen, self._outputs, self._around.facts.rig.clock_of
        waited_for = [topic for topic in owners if not TOPICS[topic].latched]
        lanes = lanes_of(waited_for, lambda topic: owners[topic], self.pipeline, clock_of, chosen.shifts)
        return ReplayDelivery(Host(self.pipeline, lanes, outputs.end), self._around.diagnostics.finish)

    def _subscribe(self) -> None:
        around = self._around
        takers = self._entrance.takers(self._receive, self._outputs.origins.keep)
        for topic, owner in self._present:
            if around.reading.reads(topic, owner):
                continue
            for entry in subscribe(around.node, around.choice, topic, owner, around.flow, takers):
                self._inputs[entry.name] = entry
                around.health.add(entry.arrivals, self._entrance.taker(topic))
                if not TOPICS[topic].latched and entry.carrier != "audio_common":
                    around.ends.watch(entry.name)

    def _take_over(self, states: Mapping[str, bytes]) -> None:
        """Resume from kept states, stage by stage; a stage whose state is unusable starts empty."""
        for stage, state in states.items():
            try:
                self.pipeline.begin({stage: state})
                self._logger.info(f"stage {stage} resumes from its saved state")
            except DataError as error:
                self._logger.warning(f"stage {stage} starts without its saved state: {error}")

    def publish_states(self, kept: StateExchange) -> None:
        """Hand over the states of the stages to the keeper."""
        self._delivery.wait()
        kept.publish(self.pipeline.lasting_state)

    # --------------------------------------------------------------- work

    def _receive(self, entry: Input, queue: str, stamp_ns: int, data: bytes | ViewFrame) -> None:
        """Enqueue a message together with its companions, e.g. the depth map of an image."""
        if self._around.pausing is not None and self._around.pausing.leaves_out():
            return
        item = QueuedMessage(entry.topic, entry.owner, stamp_ns, (entry, data), time.monotonic_ns())
        for bundle in self._companions.put(item):
            last = bundle[-1]
            key = queue if last.topic == entry.topic else f"{last.topic} {last.owner}"
            self._around.worker.put(key, self._time_of(last), bundle)

    def _time_of(self, item: QueuedMessage) -> int:
        """Return the time by which an item is grouped with others, ns.

        In live flow, images with a wrong timestamp get their time of arrival.
        """
        if not self._live or item.topic != "image":
            return item.stamp_ns
        time_ns, notices = self._times.time_of(item.owner, item.stamp_ns, item.came_ns, self._now_ns())
        for notice in notices if self._has_common_clock else ():
            self._around.tally.tell(self._around.tally.first, notice)
        return time_ns

    def do(self, batch: Sequence[Any]) -> None:
        """Process a batch from the queue: either bundles of messages, or a single call."""
        if callable(batch[0]):
            batch[0]()
        else:
            self._work_on(batch)

    def _work_on(self, bundles: Sequence[tuple[QueuedMessage, ...]]) -> None:
        if self._around.kept is not None:
            self._around.kept.tried()
        arrivals = []
        for item in (item for bundle in bundles for item in bundle):
            entry, data = item.message
            record = self._entrance.record(entry, data)
            arrivals.append(ArrivedRecord(entry.topic, entry.owner, item.stamp_ns, record, item.came_ns))
            entry.count += 1
            if not self._live:
                self._around.ends.taken(entry.name)
        self._delivery.take(arrivals)

    def _take_own(self, entry: OwnInput, frame: ViewFrame) -> None:
        """Count and enqueue an image of a live camera of this node; runs on the camera's thread."""
        overtaken = entry.came(frame, self._age_ns(frame))
        if overtaken:
            self._entrance.lost(entry, "overtaken", overtaken)
        self._receive(entry, f"{entry.topic} {entry.owner}", frame.stamp_ns, frame)

    def put_own(self, entry: OwnInput, record: Any) -> None:
        """Process the next record of a recording of this node."""
        self._work_on([(QueuedMessage(entry.topic, entry.owner, record.stamp_ns, (entry, record)),)])

    def end(self, key: Key) -> None:
        """End a topic of a recording of this node."""
        self._replay.end(key)

    def fetch(self) -> bool:
        """Read the next record that the stages need from a recording; return whether there is more to do."""
        delivery = self._delivery
        return isinstance(delivery, ReplayDelivery) and self._around.reading.fetch(delivery.host)

    def _gave(self, topic: str, record: Any) -> None:
        giver = next(spec.name for spec in self.pipeline.wiring.specs if topic in spec.outputs)
        self._outputs.publish(topic, record, self._around.facts.rig)
        self._around.tally.gave(giver, self._age_ns(record))

    def _now_ns(self) -> int:
        """Return the time of the node, ns."""
        return now_of(self._around.node)

    def _age_ns(self, record: Any) -> int | None:
        """Return the time since the timestamp of a record, ns; None in replay or without timestamp."""
        stamp_ns = getattr(record, "stamp_ns", None)
        if stamp_ns is None or not self._live:
            return None
        return int(now_of(self._around.node) - stamp_ns)

    def _refused(self, stage: str, error: DataError) -> None:
        """Count a refused record.

        A live stage that refuses all records is reset: its state is corrupt, e.g. from a bad record that
        looked valid.
        """
        self._around.tally.refuse(stage, error)
        if self._live and self._around.tally.refuses_all(stage):
            self._delivery.wait()
            self.pipeline.begin_anew(stage)
            self._logger.warning(f"stage {stage} has refused all recent records: its state is reset")

    def _stepped(self, stage: str, duration_ns: int) -> None:
        self._around.tally.stepped(stage, self._around.reading.duration_ns(stage, duration_ns))
        if stage in self._services:
            self._services[stage].look()

    # ---------------------------------------------------------------- changes and end

    def change_rig(self, rig: Rig, used: Rig) -> Sequence[str]:
        """Adopt another rig; return the stages that restart with an empty state.

        Args:
            used: The rig with the cameras of this node only.
        """
        self._delivery.wait()
        self._around.facts.take_over(rig)
        return self.pipeline.change_rig(used)

    @property
    def _replay(self) -> ReplayDelivery:
        assert isinstance(self._delivery, ReplayDelivery)
        return self._delivery

    def topic_over(self, name: str) -> None:
        """End a topic after all its messages have been processed (replay)."""
        entry = self._inputs[name]
        self._replay.end((entry.topic, entry.owner))

    def _owner_over(self, topic: str, owner: str) -> None:
        """Announce the end of an output topic of a camera or device (replay)."""
        if not self._live:
            self._outputs.end(topic, owner)


def _is_taken(topic: str) -> bool:
    """Return whether a stage of the table takes a topic."""
    return any(port.topic == topic for spec in NODES.values() for port in spec.inputs)
