"""The one adapter round stages: subscribe, convert, step, publish, report."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter

from panoptic_ros.domain import Rig, SkeletonModel, ViewFrame
from panoptic_ros.errors import DataError, PanopticError
from panoptic_ros.graph.build import ports_in_use, resolve, rows_in_use
from panoptic_ros.graph.companions import Companions, Item
from panoptic_ros.graph.counters import StageStatistics
from panoptic_ros.graph.flow import live_defaults
from panoptic_ros.graph.health import Doing, Health
from panoptic_ros.graph.host import Host, lanes_of
from panoptic_ros.graph.lane_groups import Key
from panoptic_ros.graph.nodes import NODES
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.graph.queue_choice import queue_for
from panoptic_ros.graph.schedule import Place
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.graph.under_way import UnderWay
from panoptic_ros.graph.wiring import Wiring
from panoptic_ros.nodes.compilation import Compilation
from panoptic_ros.nodes.delivery import Arrival, Delivery, LiveDelivery, ReplayDelivery
from panoptic_ros.nodes.diagnostics import Diagnostics
from panoptic_ros.nodes.entrance import Entrance
from panoptic_ros.nodes.facts import Facts
from panoptic_ros.nodes.inputs import Input, InputChoice, subscribe
from panoptic_ros.nodes.kept_states import KeptStates
from panoptic_ros.nodes.outputs import Outputs
from panoptic_ros.nodes.own_cameras import OwnCameras, OwnInput
from panoptic_ros.nodes.own_reading import OwnReading
from panoptic_ros.nodes.parameters import declare_config, declare_flow
from panoptic_ros.nodes.pausing import Pausing
from panoptic_ros.nodes.progress import ProgressTold
from panoptic_ros.nodes.reports import reports_of
from panoptic_ros.nodes.rig_changes import RigChanges
from panoptic_ros.nodes.streams import StreamEnds
from panoptic_ros.nodes.tally import Tally
from panoptic_ros.nodes.worker import Worker
from panoptic_ros.params import named_words
from panoptic_ros.stage import StageContext

Extras = Callable[[Node, str, SkeletonModel], Mapping[str, Any]]  # what stages need beyond the context


class StageNode(Node):
    """A node that runs one or more connected stages of `graph.nodes.NODES`.

    Records go from stage to stage as they are; messages are made for topics that leave the process or that
    somebody subscribes to. Waits for the latched rig and skeleton model, then builds the stages. A message
    with bad content is counted, reported on /diagnostics and dropped; any other error ends the node (see
    `fault`).

    Parameters: those of the stages' configurations, of several stages as `<stage>.<name>`; `flow` (live or
    replay), `replay_window` (see `graph.flow`), `cameras` (only these; empty: all of the rig); `graph`: all
    stages that run in the graph (empty: those that this node needs), and the ports that parameters of them
    switch on; `marked`: whether nodes tell each other places (replay, see `graph.host`);
    `shifts`: "camera or topic=ns", see `graph.lanes.Lane` (replay);
    inputs as in `nodes.inputs.InputChoice`.

    Args:
        stages: names.
        extras: what stages need beyond the context, by (node, prefix of its parameters, skeleton).
        own: cameras that the node reads itself; their images are sent only to those who subscribe.
    """

    def __init__(
        self,
        stages: str | Sequence[str],
        overrides: Mapping[str, Any] = {},
        extras: Mapping[str, Extras] = {},
        name: str | None = None,
        own: OwnCameras | None = None,
    ):
        names = [stages] if isinstance(stages, str) else list(stages)
        super().__init__(
            name or names[0],
            parameter_overrides=[Parameter(key, value=value) for key, value in overrides.items()],
        )
        self._extras = extras
        self._flow = declare_flow(self)
        self._reading = OwnReading(self, self._flow, own, self._put_own, self._end_own)
        self._cameras = self._names("cameras")
        self._graph = self._names("graph")
        self._shifts = {name: int(ns) for name, ns in named_words("shifts", self._names("shifts")).items()}
        self._marked = bool(self.declare_parameter("marked", False).value)
        self.prefixes = {stage: f"{stage}." if len(names) > 1 else "" for stage in names}
        self._configs = {
            stage: declare_config(
                self, resolve(NODES[stage].config), live_defaults(self._flow.name, stage), prefix
            )
            for stage, prefix in self.prefixes.items()
        }
        self._ports_used = {*self._graph, *ports_in_use(self._configs)}
        self._tally = Tally(self.get_logger(), names)
        ports = Wiring(names, table=rows_in_use(self._ports_used)).inputs
        self._choice = InputChoice(self, ports, self._graph)
        self._pipeline: Pipeline | None = None
        self._delivery: Delivery | None = None
        self._companions = Companions((), ())
        self._inputs: dict[str, Input] = {}  # by full name
        self._fault: PanopticError | None = None
        self._health = Health(self.get_name(), self._tally.statistics, live=self._flow.name == "live")
        self._diagnostics = Diagnostics(self, self._health, self._look)
        self._compilation = Compilation(self.get_logger(), self._diagnostics.publish)
        self._reports = reports_of(self, Wiring(names))
        self._diagnostics.more = lambda: [
            status for report in self._reports.values() for status in report.statuses()
        ]
        self._worker = Worker(self._work, self._dropped, self._fetch)
        self._ends = StreamEnds(self, lambda topic: self._worker.note(lambda: self._topic_over(topic)))
        self._outputs = Outputs(self, self._flow, (), self._ends, None)
        live = self._flow.name == "live"
        self._kept = KeptStates(self, names, self._hand_over, self._tally.has_taken) if live else None
        self._pausing = Pausing(self) if live else None
        self._rig_changes = RigChanges(self, self._cameras, self._worker.note, self._change_rig)
        self._facts = Facts(
            self, self._begin, self._refuse_message,
            lambda rig: self._rig_changes.offer(rig, self._facts.rig),
            needs_cameras=not all(port.optional for stage in names for port in NODES[stage].inputs),
        )  # fmt: skip
        self._entrance = Entrance(self._facts, self._tally, self._reports, self._wiring)

    def _wiring(self) -> Wiring:
        assert self._pipeline is not None
        return self._pipeline.wiring

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

    @property
    def statistics(self) -> Mapping[str, StageStatistics]:
        """What each stage counted."""
        return self._tally.statistics

    def close(self) -> None:
        """Stop the worker, and what reads cameras."""
        self._reading.close()
        self._worker.stop()
        self._compilation.close()

    def _look(self) -> None:
        """What the stages are at, for /diagnostics."""
        stage, since_ns = self._pipeline.stepping if self._pipeline is not None else ("", 0)
        self._health.doing = Doing(stage, since_ns, self._compilation.kernel)
        self._health.awaited, self._health.unfit = self._facts.missing, self._facts.unfit

    # -------------------------------------------------------------- start

    def _begin(self, rig: Rig, skeleton: SkeletonModel) -> None:
        def start(states: Mapping[str, bytes]) -> None:
            try:
                self._start(rig, skeleton, states)
            except PanopticError as error:
                self._fault = error

        if self._kept is None:
            start({})
        else:
            self._kept.when_known(start)

    def _start(self, rig: Rig, skeleton: SkeletonModel, states: Mapping[str, bytes]) -> None:
        used = self._used(rig)
        self._pipeline = pipeline = self._make_pipeline(used, skeleton)
        self._take_over(states)
        owners = self._reading.owners(
            {port.topic: self._choice.owners(port.topic, used) for port in pipeline.wiring.inputs}
        )
        present = [(topic, owner) for topic, found in owners.items() for owner in found]
        self._outputs = self._open_outputs(pipeline, used)
        for own in self._reading.inputs(present):  # before the worker may fetch their records
            self._health.add(own.arrivals, self._entrance.taker(own.topic))
        if self._flow.name == "replay":
            self._delivery = self._in_order(pipeline, rig, owners)
            self._worker.start(queue_for(pipeline.wiring, self._flow, present))
        else:
            under_way = UnderWay(pipeline, self._reading.pool, self._worker.urge)
            self._delivery = LiveDelivery(under_way)
            ports = [port for port in pipeline.wiring.inputs if port.patience_ns]
            self._companions = Companions(ports, present)
            self._worker.start(queue_for(pipeline.wiring, self._flow, present, lambda: under_way.full))
        self._subscribe(present)
        self._reading.start(used, self._take_own, self._fail)
        gc.freeze()  # what is there by now stays; to look through it takes longer than a period
        self.get_logger().info(f"ready: {len(self._inputs)} topics in, {len(self._outputs)} out")

    def _make_pipeline(self, used: Rig, skeleton: SkeletonModel) -> Pipeline:
        extras: dict[str, Any] = {}
        for stage, prefix in self.prefixes.items():
            if stage in self._extras:
                extras |= self._extras[stage](self, prefix, skeleton)
        around = [name for name in NODES if name in {*self._graph, *self.prefixes}]
        reading, context = self._reading, StageContext(used, skeleton, extras)
        reading.open(used, self._configs, context, self._ports_used, self._shifts)
        return Pipeline(
            self._configs, replace(context, extras={**extras, "looks": reading.looks}), list(self.prefixes),
            on_record=self._gave, on_notice=self._tally.tell, on_refused=self._refused,
            on_end=self._owner_over, on_step=self._stepped, on_cpu=self._tally.used,
            clock=time.monotonic_ns, cpu_clock=time.thread_time_ns, everywhere=around, table=reading.table,
            used=self._ports_used,
        )  # fmt: skip

    def _open_outputs(self, pipeline: Pipeline, used: Rig) -> Outputs:
        replay = self._flow.name == "replay"
        progress = ProgressTold(self, self._progress_heard) if replay and self._marked else None
        final = {
            topic for topic in pipeline.wiring.given if TOPICS[topic].latched or not self._is_taken(topic)
        }
        outputs = Outputs(self, self._flow, pipeline.wiring.leaving | final, self._ends, progress)
        for topic in sorted(pipeline.wiring.given):
            for owner in self._choice.owners(topic, used):
                outputs.open(topic, owner)
        return outputs

    def _in_order(self, pipeline: Pipeline, rig: Rig, owners: Mapping[str, Sequence[str]]) -> ReplayDelivery:
        waited_for = [topic for topic in owners if self._is_waited_for(topic)]
        lanes = lanes_of(waited_for, lambda topic: owners[topic], pipeline, rig.clock_of, self._shifts)
        outputs = self._outputs
        host = Host(pipeline, lanes, marked=self._marked, on_marker=outputs.mark, on_end=outputs.end)
        return ReplayDelivery(host, self._over)

    def _subscribe(self, present: Sequence[Key]) -> None:
        takers = self._entrance.takers(self._receive, self._outputs.origins.keep)
        for topic, owner in present:
            if self._reading.reads(topic, owner):
                continue
            for entry in subscribe(self, self._choice, topic, owner, self._flow, takers):
                self._inputs[entry.name] = entry
                self._health.add(entry.arrivals, self._entrance.taker(topic))
                if self._is_waited_for(topic) and entry.carrier != "audio_common":
                    self._ends.watch(entry.name)

    def _take_over(self, states: Mapping[str, bytes]) -> None:
        """Begin with what stages of this name remembered, each by itself."""
        assert self._pipeline is not None
        for stage, state in states.items():
            try:
                self._pipeline.begin({stage: state})
                self.get_logger().info(f"stage {stage} goes on from what it remembered")
            except DataError as error:
                self.get_logger().warning(f"stage {stage} begins anew: {error}")

    def _hand_over(self) -> None:
        """Let others keep what the stages remember; taken between two records."""
        self._worker.note(self._publish_states)

    def _publish_states(self) -> None:
        assert self._pipeline is not None and self._kept is not None and self._delivery is not None
        self._delivery.wait()
        self._kept.publish(self._pipeline.state())

    def _used(self, rig: Rig) -> Rig:
        return rig.subset(self._cameras) if self._cameras else rig

    def _is_taken(self, topic: str) -> bool:
        """Whether a stage of the table takes a topic."""
        return any(port.topic == topic for spec in NODES.values() for port in spec.inputs)

    def _is_waited_for(self, topic: str) -> bool:
        """Whether messages of a topic are sure to come, and have an end: the latched only from a stage of
        the graph.
        """
        assert self._pipeline is not None
        return not TOPICS[topic].latched or (self._marked and topic in self._pipeline.wiring.given_around)

    # --------------------------------------------------------------- work

    def _receive(self, entry: Input, queue: str, stamp_ns: int, data: bytes | ViewFrame) -> None:
        """Enqueue a message, with those that belong to it."""
        if self._pausing is not None and self._pausing.leaves_out():
            return
        for bundle in self._companions.put(Item(entry.topic, entry.owner, stamp_ns, (entry, data))):
            last = bundle[-1]
            key = queue if last.topic == entry.topic else f"{last.topic} {last.owner}"
            self._worker.put(key, last.stamp_ns, bundle)

    def _work(self, batch: Sequence[Any]) -> None:
        """What is enqueued are messages with those that belong to them, or calls."""
        if callable(batch[0]):
            batch[0]()
        else:
            self._work_on(batch)

    def _work_on(self, bundles: Sequence[tuple[Item, ...]]) -> None:
        assert self._delivery is not None
        if self._kept is not None:
            self._kept.tried()
        arrivals = []
        for item in (item for bundle in bundles for item in bundle):
            entry, data = item.message
            record = self._entrance.record(entry, data)
            arrivals.append(Arrival(entry.topic, entry.owner, item.stamp_ns, record))
            entry.count += 1
            self._ends.taken(entry.name)
        self._delivery.take(arrivals)

    def _take_own(self, entry: OwnInput, frame: ViewFrame) -> None:
        """A live camera of this node has given an image; on the camera's thread."""
        overtaken = entry.came(frame, self._age_ns(frame))
        if overtaken:
            self._entrance.lost(entry, "overtaken", overtaken)
        self._receive(entry, f"{entry.topic} {entry.owner}", frame.stamp_ns, frame)

    def _put_own(self, entry: OwnInput, record: Any) -> None:
        """The next record of a recording of this node."""
        self._work_on([(Item(entry.topic, entry.owner, record.stamp_ns, (entry, record)),)])

    def _end_own(self, key: Key) -> None:
        self._replay.end(key)

    def _fetch(self) -> bool:
        """Take what the stages want next of a recording of this node; whether there is more to do."""
        delivery = self._delivery
        return isinstance(delivery, ReplayDelivery) and self._reading.fetch(delivery.host)

    def _fail(self, error: PanopticError) -> None:
        self._fault = error

    def _gave(self, topic: str, record: Any) -> None:
        assert self._delivery is not None
        giver = next(spec.name for spec in self._wiring().specs if topic in spec.outputs)
        if self._outputs.publish(topic, record, self._facts.rig):
            self._delivery.gave(topic, record)
        self._tally.gave(giver, self._age_ns(record))

    def _age_ns(self, record: Any) -> int | None:
        """Since the stamp of a record (live)."""
        stamp_ns = getattr(record, "stamp_ns", None)
        if stamp_ns is None or self._flow.name != "live":
            return None
        return int(self.get_clock().now().nanoseconds - stamp_ns)

    def _refused(self, stage: str, error: DataError) -> None:
        """A stage has refused a record. One that refuses all is spoilt, e.g. by a record that looked good."""
        assert self._pipeline is not None
        self._tally.refuse(stage, error)
        if self._flow.name == "live" and self._tally.refuses_all(stage):
            assert self._delivery is not None
            self._delivery.wait()
            self._pipeline.begin_anew(stage)
            self.get_logger().warning(f"stage {stage} has refused all of late: it forgets what it knew")

    def _stepped(self, stage: str, duration_ns: int) -> None:
        self._tally.stepped(stage, self._reading.duration_ns(stage, duration_ns))

    def _refuse_message(self, error: PanopticError) -> None:
        self._tally.refuse(self._tally.first, error)

    def _dropped(self, count: int) -> None:
        self._tally.dropped(self._tally.first, "queue_full", count)

    # ---------------------------------------------------------------- what changes, and the end

    def _change_rig(self, rig: Rig) -> Sequence[str]:
        assert self._pipeline is not None and self._delivery is not None
        self._delivery.wait()
        self._facts.take_over(rig)
        return self._pipeline.change_rig(self._used(rig))

    @property
    def _replay(self) -> ReplayDelivery:
        assert isinstance(self._delivery, ReplayDelivery)
        return self._delivery

    def _progress_heard(self, name: str, place: Place, count: int) -> None:
        """Where a topic has come to; on the executor's thread."""
        entry = self._inputs.get(name)
        if entry is not None:
            key = entry.topic, entry.owner
            self._worker.note(lambda: self._replay.mark(key, place, count))

    def _topic_over(self, name: str) -> None:
        """All messages of a topic have been taken (replay)."""
        entry = self._inputs[name]
        self._replay.end((entry.topic, entry.owner))

    def _owner_over(self, topic: str, owner: str) -> None:
        """The stages give no more of a camera or device."""
        if self._flow.name == "replay":
            self._outputs.end(topic, owner)

    def _over(self) -> None:
        """All that comes is taken (replay)."""
        if not self._diagnostics.finished:
            self._diagnostics.finish()
