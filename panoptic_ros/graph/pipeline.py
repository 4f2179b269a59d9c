"""Stages of the table in one process: the same output as the graph, without ROS.

Nothing is dropped, and no two stages run at the same time. A record passes through all stages before the next
one is taken. Feedback is passed on after that. `graph.schedule` defines the order.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from concurrent.futures import Future
from dataclasses import replace
from typing import Any, NamedTuple

from panoptic_ros.domain import EndOfStream, Rig
from panoptic_ros.errors import DataError
from panoptic_ros.graph.build import make_stage, ports_in_use, rows_in_use, switched_on
from panoptic_ros.graph.nodes import CHAIN, FUSION, NODES, Port
from panoptic_ros.graph.schedule import END, FLUSH, Bounds, Place, StageSchedule, StageTurn
from panoptic_ros.graph.topics import TOPICS, number_of, owner_of
from panoptic_ros.graph.wiring import Table, Wiring
from panoptic_ros.params import Config
from panoptic_ros.stage import (
    ArrivalAwareStage,
    IdleWorkStage,
    LastingStateStage,
    LatenessAwareStage,
    Notice,
    Stage,
    StageContext,
    StepResult,
)

Observer = Callable[[str, Any], None]  # (key of the topic, record)
NoticeObserver = Callable[[str, Notice], None]  # (stage, notice)

REPAIRED = "repaired_rig"  # topic of a corrected rig, which the stages use from then on


class _End(NamedTuple):
    """End of a stream on its way through the stages.

    Args:
        owner: Camera or device.
        last: Place of its last record.
        port: Port that takes it.
    """

    owner: str
    last: Place
    port: Port


class Pipeline:
    """Selected stages of the table, connected as the table says.

    Args:
        configs: One per stage, see `graph.build.configure`.
        context: Rig, skeleton and extras.
        stages: Their names. Stages that a parameter switches off are left out.
        on_record: Called with every output record, in order.
        on_notice: Called with every notice.
        on_refused: Called with (stage, error) if a stage refuses a record, which is then dropped. None: the
            error is raised.
        on_end: Called with (topic, owner) when these stages give no more records of a camera or device on a
            topic.
        on_step: Called with (stage, duration in ns) after every step, except for records of optional ports.
        on_cpu: Called with (stage, processor time in ns) after every step.
        clock, cpu_clock: Monotonic time and processor time of the thread, ns. The pipeline reads no other
            clock.
        everywhere: All stages of the graph, of which the pipeline may run a part. None: it runs all.
        table: The rows.
        used: Ports that a parameter of any stage of the graph switches on, see `graph.build.ports_in_use`.
            None: those of the configurations.
    """

    def __init__(
        self,
        configs: Mapping[str, Config],
        context: StageContext,
        stages: Collection[str] = CHAIN,
        *,
        on_record: Observer | None = None,
        on_notice: NoticeObserver | None = None,
        on_refused: Callable[[str, DataError], None] | None = None,
        on_end: Callable[[str, str], None] | None = None,
        on_step: Callable[[str, int], None] | None = None,
        on_cpu: Callable[[str, int], None] | None = None,
        clock: Callable[[], int] | None = None,
        cpu_clock: Callable[[], int] | None = None,
        everywhere: Collection[str] | None = None,
        table: Table = NODES,
        used: Collection[str] | None = None,
    ):
        self._apart = frozenset(spec.name for spec in table.values() if spec.apart)
        table = rows_in_use(ports_in_use(configs, table) if used is None else used, table)
        names = switched_on(stages, configs, table)
        self.wiring = Wiring(names, names if everywhere is None else everywhere, table)
        self.schedule = StageSchedule(self.wiring)
        self._configs, self._context = configs, context
        self._stages = [self._make(spec.name) for spec in self.wiring.specs]
        self._find_special_stages()
        self._pushed = 0
        self._begun: dict[tuple[int, int], Future[tuple[Any, int, int]]] = {}  # by stage and id of the record
        self._on_record = on_record or (lambda topic, record: None)
        self._on_notice = on_notice or (lambda stage, notice: None)
        self._on_refused = on_refused
        self._on_end = on_end or (lambda topic, owner: None)
        self._on_step = on_step or (lambda stage, duration: None)
        self._on_cpu = on_cpu or (lambda stage, duration: None)
        self._clock, self._cpu_clock = clock or (lambda: 0), cpu_clock or (lambda: 0)
        self.stepping: tuple[str, int] = ("", 0)  # stage that performs a step, and its start time, ns

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the running stages, in order."""
        return tuple(spec.name for spec in self.wiring.specs)

    def stage(self, name: str) -> Any:
        """Return a running stage. `change_rig` replaces it."""
        return self._stages[self.names.index(name)]

    def push(self, topic: str, record: Any) -> None:
        """Pass a record from outside, and everything that follows from it, through the stages.

        Raises:
            DataError: if a stage refuses it and there is no `on_refused`.
        """
        self.schedule.add(topic, record, self._place_of_push(topic))
        self.run()

    def waited(self, ns: int) -> None:
        """Report to the stages how long the next pushed records have waited (live)."""
        for stage in self._punctual:
            stage.waited(ns)

    def arrived(self, came_ns: int, host_ns: int) -> None:
        """Report to the stages when the next pushed records arrived (live, see `stage.ArrivalAwareStage`)."""
        for stage in self._timed_stages:
            stage.arrived(came_ns, host_ns)

    def begin_step(
        self, topic: str, record: Any, add: Callable[[str, Callable[[], Any]], Future[Any]]
    ) -> Future[Any] | None:
        """Start the first step of a record in parallel, if its stage works on cameras or devices separately.

        A later `push` of the record then passes on the result.

        Args:
            add: Schedules a call for a camera or device, after its earlier calls (see `graph.under_way`).

        Returns:
            the future of the step; None: nothing was started.
        """
        first = self.wiring.readers[topic][0].stage
        if self.names[first] not in self._apart:
            return None
        stage = self._stages[first]
        step = add(owner_of(topic, record), lambda: self._timed(stage, record))
        self._begun[first, id(record)] = step
        return step

    def is_beside(self, topic: str) -> bool:
        """Return whether a topic from outside is only a companion of other records, for all its readers."""
        return all(self.wiring.port(reader).optional for reader in self.wiring.readers[topic])

    def end(self, topic: str, owner: str) -> None:
        """End a topic of a camera or device."""
        self.add_end(topic, owner, self._place_of_push(topic))
        self.run()

    def flush(self) -> None:
        """End all streams: flush every stage in order. The pipeline is then as new."""
        for number in range(len(self._stages)):
            self.flush_stage(number)
            self.run()
        self.schedule.open_all()

    def state(self) -> dict[str, bytes]:
        """Return the state that determines all later output, by stage.

        Between two records, the pipeline holds no other data.
        """
        return {name: stage.state() for name, stage in zip(self.names, self._stages)}

    def lasting_state(self) -> dict[str, bytes]:
        """Return the state that matters after a pause, by stage; some stages need less than `state`."""
        return {
            name: stage.lasting_state() if isinstance(stage, LastingStateStage) else stage.state()
            for name, stage in zip(self.names, self._stages)
        }

    def begin(self, states: Mapping[str, bytes]) -> None:
        """Resume from a state; stages that it lacks keep their own.

        Raises:
            DataError: if a state does not belong to its stage.
        """
        for name, stage in zip(self.names, self._stages):
            if name in states:
                stage.begin(states[name])

    def begin_anew(self, name: str) -> None:
        """Let a stage forget its measurements."""
        self._stages[self.names.index(name)].forget()

    def change_rig(self, rig: Rig) -> tuple[str, ...]:
        """Use another rig from the next record on. Stages keep the part of their state that is still valid.

        Returns:
            the stages that restart with an empty state, because their state refers to other cameras.
        """
        return self._change_rig(rig, self.names)

    def _change_rig(self, rig: Rig, names: Collection[str]) -> tuple[str, ...]:
        """Use another rig in some of the stages; see `change_rig`."""
        self._context = replace(self._context, rig=rig)
        anew = []
        for number, name in enumerate(self.names):
            if name not in names:
                continue
            stage, before = self._make(name), self._stages[number].state()
            try:
                stage.begin(before)
            except DataError:
                anew.append(name)
            self._stages[number] = stage
        self._find_special_stages()
        return tuple(anew)

    # ------------------------------------------------------------------ for hosts, which define places

    def add_end(self, topic: str, owner: str, last: Place) -> None:
        """End a topic of a camera or device.

        Args:
            last: Place of its last record.
        """
        for reader in self.wiring.readers.get(topic, ()):
            self.schedule.wait(reader, _End(owner, last, self.wiring.port(reader)), (*last, END))

    def flush_stage(self, number: int) -> None:
        """Flush a stage; it takes no more records, including feedback."""
        self.schedule.close(number)
        turn = StageTurn((FLUSH, self.wiring.ranks[number]), number, None)
        self._hand_on(turn, self._stages[number].flush())

    def run(self, bounds: Bounds | None = None) -> None:
        """Process all records whose turn has come.

        Args:
            bounds: Lower bounds of the places that may still come from outside. None: no earlier record can
                come.
        """
        while True:
            turn = self.schedule.next(bounds)
            if turn is None:
                return
            self._step(turn)

    # ------------------------------------------------------------------ steps

    def _make(self, name: str) -> Stage[Any, Any]:
        return make_stage(name, self._configs[name], self._context, self.wiring.table)

    def _find_special_stages(self) -> None:
        """Find the stages with extra interfaces: lateness, arrival times, and work in idle time."""
        self._punctual = [stage for stage in self._stages if isinstance(stage, LatenessAwareStage)]
        self._timed_stages = [stage for stage in self._stages if isinstance(stage, ArrivalAwareStage)]
        self._idle_work = [stage for stage in self._stages if isinstance(stage, IdleWorkStage)]

    def _place_of_push(self, topic: str) -> Place:
        self._pushed += 1
        return (self._pushed, 0, number_of(topic))

    def _take_end(self, turn: StageTurn, end: _End) -> None:
        """Report an end to the stage if its port wants it, and to the readers of its one-to-one outputs."""
        if end.port.tells_end:
            self._step(turn._replace(record=EndOfStream(end.owner)))
        outputs = () if end.port.optional else self.wiring.specs[turn.stage].outputs
        for topic in (key for key in outputs if TOPICS[key].by_stamp):
            self.add_end(topic, end.owner, (*end.last[:-1], number_of(topic)))
            self._on_end(topic, end.owner)

    def _step(self, turn: StageTurn) -> None:
        if isinstance(turn.record, _End):
            self._take_end(turn, turn.record)
            return
        stage, name = self._stages[turn.stage], self.wiring.specs[turn.stage].name
        self.stepping = name, self._clock()
        begun = self._begun.pop((turn.stage, id(turn.record)), None)
        try:
            result, duration_ns, cpu_ns = (
                begun.result() if begun is not None else self._timed(stage, turn.record)
            )
        except DataError as error:
            if self._on_refused is None:
                raise
            self._on_refused(name, error)
            return
        finally:
            self.stepping = "", 0
        if not turn.beside:
            self._on_step(name, duration_ns)
        self._on_cpu(name, cpu_ns)
        self._hand_on(turn, result)
        if stage in self._idle_work:
            cpu = self._cpu_clock()
            stage.settle()
            self._on_cpu(name, self._cpu_clock() - cpu)

    def _timed(self, stage: Stage[Any, Any], record: Any) -> tuple[StepResult[Any], int, int]:
        start, cpu = self._clock(), self._cpu_clock()
        return stage.step(record), self._clock() - start, self._cpu_clock() - cpu

    def _hand_on(self, turn: StageTurn, result: StepResult[Any]) -> None:
        spec = self.wiring.specs[turn.stage]
        for notice in result.notices:
            self._on_notice(spec.name, notice)
        for record in result.outputs:
            topic = spec.output_for(record)
            self.schedule.add(topic, record, self.schedule.place_of_next(turn, topic), turn.stage)
            self._on_record(topic, record)
            if topic == REPAIRED:
                # Stages beside the images run in other processes of the graph, so they keep the rig here too.
                self._change_rig(record, [name for name in self.names if name not in self._apart])


def records_of(
    topic: str,
    items: Iterable[Any],
    configs: Mapping[str, Config],
    context: StageContext,
    stages: Collection[str] = FUSION,
) -> list[Any]:
    """Return all records that a new pipeline gives on a topic.

    Args:
        topic: Key.
        items: Records of the only topic that the stages take from outside, in order.
    """
    found: list[Any] = []
    pipeline = Pipeline(
        configs,
        context,
        stages,
        on_record=lambda key, record: found.append(record) if key == topic else None,
    )
    (entrance,) = (port.topic for port in pipeline.wiring.inputs if not port.optional)
    for item in items:
        pipeline.push(entrance, item)
    pipeline.flush()
    return found
