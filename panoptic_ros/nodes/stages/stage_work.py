"""The stages of a node at work: messages in, one step after the other, messages out.

What a node publishes: a message only where somebody wants one.

Pausing and resuming a live node by a service, in place of a lifecycle: it keeps what it knows.

How records reach the stages of a node: live as they come, in replay in the order of their places.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

from rclpy.node import Node

from panoptic_ros.domain import Rig, ViewFrame
from panoptic_ros.errors import DataError, PanopticError
from panoptic_ros.graph.continuity import AlignedTimes
from panoptic_ros.graph.flow import Flow
from panoptic_ros.graph.health import Health
from panoptic_ros.graph.host import Host, Key, lanes_of
from panoptic_ros.graph.nodes import NODES
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.graph.queues import Companions, Item, queue_for
from panoptic_ros.graph.topics import TOPICS, owner_of
from panoptic_ros.graph.under_way import UnderWay
from panoptic_ros.io.messages import to_message
from panoptic_ros.io.messages.records import Origins
from panoptic_ros.nodes.health.diagnostics import Diagnostics
from panoptic_ros.nodes.health.reports import Report
from panoptic_ros.nodes.health.tally import Tally
from panoptic_ros.nodes.middleware.family import message_class, ros_messages, service_class
from panoptic_ros.nodes.middleware.quality import CLOCKS, data_quality
from panoptic_ros.nodes.middleware.read_together import GatheringNode
from panoptic_ros.nodes.middleware.runtime import now_of
from panoptic_ros.nodes.middleware.streams import StreamEnds
from panoptic_ros.nodes.middleware.worker import Worker
from panoptic_ros.nodes.stages.facts import Facts
from panoptic_ros.nodes.stages.inputs import Entrance, Input, InputChoice, subscribe
from panoptic_ros.nodes.stages.kept_states import KeptStates
from panoptic_ros.nodes.stages.own_cameras import OwnInput, OwnReading
from panoptic_ros.params import Config
from panoptic_ros.stage import StageContext


class Outputs:
    """Publishers of topics.

    Args:
        leaving: keys of topics that are always published; others only while somebody subscribes.
        ends: tells the ends of topics (replay).

    Attributes:
        origins: of records that go on inside of messages that leave the process.
    """

    def __init__(self, node: Node, flow: Flow, leaving: Collection[str], ends: StreamEnds):
        self._node, self._flow, self._leaving, self._ends = node, flow, frozenset(leaving), ends
        self.origins = Origins(TOPICS[topic].record for topic in leaving)
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
        """Publish a record, if it leaves the process or somebody subscribes."""
        key = topic, owner_of(topic, record)
        publisher = self._publishers[key]
        if topic not in self._leaving and not publisher.get_subscription_count():
            return
        publisher.publish(to_message(record, self._messages, rig.frame_id))
        self._sent[key] = self._sent.get(key, 0) + 1

    def end(self, topic: str, owner: str | None = None) -> None:
        """Tell that no more comes on a topic, of one camera or device or (None) of all that were not told
        yet.
        """
        for key in [key for key in self._publishers if key[0] == topic and owner in (None, key[1])]:
            if self._sent.get(key, 0) >= 0:
                self._ends.announce(self._publishers[key].topic_name, self._sent.get(key, 0))
                self._sent[key] = -1


SERVICE = "std_srvs/srv/SetBool"


class Pausing:
    """Offers `~/pause`: true = take nothing that comes from now on, false = go on.

    Identities, tables of noise and clocks stay; people who were there are found again where they are by then.
    """

    def __init__(self, node: Node):
        self._node = node
        self.paused = False
        self.left_out = 0  # messages since it was paused
        self._service = node.create_service(service_class(SERVICE), "~/pause", self._asked)

    def leaves_out(self) -> bool:
        """Whether a message that has come is left out; counts it."""
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
            response.message = f"goes on; {self.left_out} messages were left out"
        else:
            response.message = "was not paused"
        self.paused = bool(request.data)
        if response.success:
            self._node.get_logger().info(response.message)
        return response


class Arrival(NamedTuple):
    """What has come on a topic of a camera or device, and when, on the monotonic clock; record None: it could
    not be used."""

    topic: str
    owner: str
    stamp_ns: int
    record: Any | None
    came_ns: int


class Delivery(Protocol):
    """All methods are called on the node's worker."""

    def take(self, arrivals: Sequence[Arrival]) -> None:
        """What has come, of one instant where it is known to be."""

    def wait(self) -> None:
        """Until no stage is at work."""


class LiveDelivery:
    """Stages take records as they come.

    Args:
        now_ns: the clock that stamps of cameras should be on.
    """

    def __init__(self, under_way: UnderWay, now_ns: Callable[[], int] = time.time_ns):
        self._under_way, self._now_ns = under_way, now_ns

    def take(self, arrivals: Sequence[Arrival]) -> None:
        came_ns = arrivals[0].came_ns
        waited_ns = time.monotonic_ns() - came_ns
        self._under_way.waited(waited_ns)
        self._under_way.arrived(came_ns, self._now_ns() - waited_ns)
        self._under_way.begin([(one.topic, one.record) for one in arrivals if one.record is not None])

    def wait(self) -> None:
        self._under_way.wait()


class ReplayDelivery:
    """Stages take records in the order of their places, whatever comes first (see `graph.host`).

    Args:
        on_over: called when all topics have ended and all is taken; may be called again.
    """

    def __init__(self, host: Host, on_over: Callable[[], None]):
        self.host, self._on_over = host, on_over

    def take(self, arrivals: Sequence[Arrival]) -> None:
        for one in arrivals:
            self.host.put(one.topic, one.owner, one.stamp_ns, one.record)
        self._advance()

    def wait(self) -> None:
        """One record is taken after the other."""

    def end(self, key: Key) -> None:
        """No more comes on a topic of a camera or device."""
        self.host.end(*key)
        self._advance()

    def _advance(self) -> None:
        self.host.advance()
        if self.host.over:
            self._on_over()


@dataclass(frozen=True)
class Surroundings:
    """What a node has before rig and skeleton model come.

    Args:
        reports: what is told of records on /diagnostics, by the name of their class.
        kept, pausing: None in replay.
    """

    node: GatheringNode
    flow: Flow
    choice: InputChoice
    reading: OwnReading
    worker: Worker
    tally: Tally
    facts: Facts
    health: Health
    diagnostics: Diagnostics
    reports: Mapping[str, Report]
    ends: StreamEnds
    kept: KeptStates | None
    pausing: Pausing | None


@dataclass(frozen=True)
class ChosenStages:
    """The stages of a node, as its parameters choose them.

    Args:
        configs: by stage. everywhere: all stages that run in the graph.
        used: ports that parameters switch on. shifts: see `StageNode`.
    """

    configs: Mapping[str, Config]
    everywhere: Sequence[str]
    used: Collection[str]
    shifts: Mapping[str, int]


class StageWork:
    """Takes what comes, lets the stages step and publishes what they give; all but the start, `_receive` and
    `_take_own` on the node's worker.

    Raises:
        PanopticError: if a stage cannot be made of its configuration.
    """

    def __init__(self, around: Surroundings, chosen: ChosenStages, context: StageContext):
        self._around, self._chosen, self._rig = around, chosen, context.rig
        self._live = around.flow.name == "live"
        self._logger = around.node.get_logger()
        self._inputs: dict[str, Input] = {}  # by full name
        self._companions = Companions((), ())
        self._times = AlignedTimes(context.rig.names)
        # stamps of a named clock agree once sync has corrected them
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
        self._entrance = Entrance(around.facts, tally, around.reports, self.pipeline.wiring)
        self._outputs = self._open_outputs()
        owners = reading.owners(
            {port.topic: around.choice.owners(port.topic, self._rig) for port in self.pipeline.wiring.inputs}
        )
        self._present = [(topic, owner) for topic, found in owners.items() for owner in found]
        under_way = UnderWay(self.pipeline, reading.pool, around.worker.urge)
        live = LiveDelivery(under_way, self._now_ns)
        self._delivery: Delivery = live if self._live else self._in_order(owners)
        self._full = (lambda: under_way.full) if self._live else (lambda: False)

    # -------------------------------------------------------------- start

    def start(self, states: Mapping[str, bytes], failed: Callable[[PanopticError], None]) -> None:
        """Begin to take what comes.

        Args:
            states: what stages remembered, by stage. failed: told why a live camera of the node has ended.
        """
        around, present, ports = self._around, self._present, self.pipeline.wiring.inputs
        self._take_over(states)
        for own in around.reading.inputs(present):  # before the worker may fetch their records
            around.health.add(own.arrivals, self._entrance.taker(own.topic))
        if self._live:
            self._companions = Companions([port for port in ports if port.patience_ns], present)
        around.worker.start(queue_for(self.pipeline.wiring, around.flow, present, self._full))
        self._subscribe()
        around.reading.start(self._rig, self._take_own, failed)
        gc.freeze()  # what is there by now stays; to look through it takes longer than a period
        self._logger.info(f"ready: {len(self._inputs)} topics in, {len(self._outputs)} out")

    def _open_outputs(self) -> Outputs:
        around, wiring = self._around, self.pipeline.wiring
        final = {topic for topic in wiring.given if TOPICS[topic].latched or not _is_taken(topic)}
        outputs = Outputs(around.node, around.flow, wiring.leaving | final, around.ends)
        for topic in sorted(wiring.given):
            for owner in around.choice.owners(topic, self._rig):
                outputs.open(topic, owner)
        return outputs

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
        """Begin with what stages of this name remembered, each by itself."""
        for stage, state in states.items():
            try:
                self.pipeline.begin({stage: state})
                self._logger.info(f"stage {stage} goes on from what it remembered")
            except DataError as error:
                self._logger.warning(f"stage {stage} begins anew: {error}")

    def publish_states(self, kept: KeptStates) -> None:
        """Hand over what the stages remember."""
        self._delivery.wait()
        kept.publish(self.pipeline.lasting_state)

    # --------------------------------------------------------------- work

    def _receive(self, entry: Input, queue: str, stamp_ns: int, data: bytes | ViewFrame) -> None:
        """Enqueue a message, with those that belong to it."""
        if self._around.pausing is not None and self._around.pausing.leaves_out():
            return
        item = Item(entry.topic, entry.owner, stamp_ns, (entry, data), time.monotonic_ns())
        for bundle in self._companions.put(item):
            last = bundle[-1]
            key = queue if last.topic == entry.topic else f"{last.topic} {last.owner}"
            self._around.worker.put(key, self._time_of(last), bundle)

    def _time_of(self, item: Item) -> int:
        """Return the time by which an item is put with others, ns; live, that of arrival for wrong stamps."""
        if not self._live or item.topic != "image":
            return item.stamp_ns
        time_ns, notices = self._times.time_of(item.owner, item.stamp_ns, item.came_ns, self._now_ns())
        for notice in notices if self._has_common_clock else ():
            self._around.tally.tell(self._around.tally.first, notice)
        return time_ns

    def do(self, batch: Sequence[Any]) -> None:
        """What is enqueued are messages with those that belong to them, or calls."""
        if callable(batch[0]):
            batch[0]()
        else:
            self._work_on(batch)

    def _work_on(self, bundles: Sequence[tuple[Item, ...]]) -> None:
        if self._around.kept is not None:
            self._around.kept.tried()
        arrivals = []
        for item in (item for bundle in bundles for item in bundle):
            entry, data = item.message
            record = self._entrance.record(entry, data)
            arrivals.append(Arrival(entry.topic, entry.owner, item.stamp_ns, record, item.came_ns))
            entry.count += 1
            if not self._live:
                self._around.ends.taken(entry.name)
        self._delivery.take(arrivals)

    def _take_own(self, entry: OwnInput, frame: ViewFrame) -> None:
        """A live camera of this node has given an image; on the camera's thread."""
        overtaken = entry.came(frame, self._age_ns(frame))
        if overtaken:
            self._entrance.lost(entry, "overtaken", overtaken)
        self._receive(entry, f"{entry.topic} {entry.owner}", frame.stamp_ns, frame)

    def put_own(self, entry: OwnInput, record: Any) -> None:
        """The next record of a recording of this node."""
        self._work_on([(Item(entry.topic, entry.owner, record.stamp_ns, (entry, record)),)])

    def end(self, key: Key) -> None:
        """No more comes of a recording of this node."""
        self._replay.end(key)

    def fetch(self) -> bool:
        """Take what the stages want next of a recording of this node; whether there is more to do."""
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
        """Since the stamp of a record (live)."""
        stamp_ns = getattr(record, "stamp_ns", None)
        if stamp_ns is None or not self._live:
            return None
        return int(now_of(self._around.node) - stamp_ns)

    def _refused(self, stage: str, error: DataError) -> None:
        """A stage has refused a record. One that refuses all is spoilt, e.g. by a record that looked good."""
        self._around.tally.refuse(stage, error)
        if self._live and self._around.tally.refuses_all(stage):
            self._delivery.wait()
            self.pipeline.begin_anew(stage)
            self._logger.warning(f"stage {stage} has refused all of late: it forgets what it knew")

    def _stepped(self, stage: str, duration_ns: int) -> None:
        self._around.tally.stepped(stage, self._around.reading.duration_ns(stage, duration_ns))

    # ---------------------------------------------------------------- what changes, and the end

    def change_rig(self, rig: Rig, used: Rig) -> Sequence[str]:
        """Work with another rig (`used`: its cameras of this node); gives the stages that begin anew."""
        self._delivery.wait()
        self._around.facts.take_over(rig)
        return self.pipeline.change_rig(used)

    @property
    def _replay(self) -> ReplayDelivery:
        assert isinstance(self._delivery, ReplayDelivery)
        return self._delivery

    def topic_over(self, name: str) -> None:
        """All messages of a topic have been taken (replay)."""
        entry = self._inputs[name]
        self._replay.end((entry.topic, entry.owner))

    def _owner_over(self, topic: str, owner: str) -> None:
        """The stages give no more of a camera or device."""
        if not self._live:
            self._outputs.end(topic, owner)


def _is_taken(topic: str) -> bool:
    """Whether a stage of the table takes a topic."""
    return any(port.topic == topic for spec in NODES.values() for port in spec.inputs)
