"""Adapter that runs stages as a ROS node.

The node declares the parameters, waits for rig and skeleton model, and starts the stages. While it compiles
kernels it takes no data, and it reports this in the log and on /diagnostics.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter

from panoptic_ros.domain import Rig, SkeletonModel
from panoptic_ros.errors import PanopticError
from panoptic_ros.graph.build import ports_in_use, resolve, rows_in_use
from panoptic_ros.graph.counters import StageStatistics
from panoptic_ros.graph.flow import live_defaults
from panoptic_ros.graph.health import Activity, NodeHealth
from panoptic_ros.graph.nodes import NODES
from panoptic_ros.graph.wiring import Wiring
from panoptic_ros.kernels import on_compilation
from panoptic_ros.nodes.health.diagnostics import Diagnostics
from panoptic_ros.nodes.health.reports import reports_of
from panoptic_ros.nodes.health.tally import Tally
from panoptic_ros.nodes.middleware.parameters import declare_config, declare_flow
from panoptic_ros.nodes.middleware.read_together import GatheringNode, SubscriptionPoller
from panoptic_ros.nodes.middleware.streams import StreamEnds
from panoptic_ros.nodes.middleware.worker import Worker
from panoptic_ros.nodes.stages.facts import FactsSubscriber, RigChanges
from panoptic_ros.nodes.stages.inputs import InputChoice
from panoptic_ros.nodes.stages.kept_states import StateExchange
from panoptic_ros.nodes.stages.own_cameras import OwnCameraReader, OwnCameras
from panoptic_ros.nodes.stages.stage_work import NodeParts, PauseService, StageSelection, StageWork
from panoptic_ros.params import Config, named_words
from panoptic_ros.stage import StageContext

TEXT = (
    "kernels are not compiled yet: the node takes data in about half a minute, once per installation; "
    "`panoptic warm-up` does it ahead"
)
TELL_S = 1.0


class Compilation:
    """Monitor of kernel compilations, active from construction until `close`.

    Args:
        tell: Called when a compilation begins, at most once a second, in the thread that compiles.
        clock: Returns a monotonic time, s.
    """

    def __init__(self, logger: Any, tell: Callable[[], None], clock: Callable[[], float] = time.monotonic):
        self._logger, self._tell, self._clock = logger, tell, clock
        self._under_way: list[str] = []  # names: a kernel, then the kernels that it calls
        self._logged = False
        self._told_s = -TELL_S
        self._stack = ExitStack()
        self._stack.enter_context(on_compilation(self._begins, self._ends))

    @property
    def kernel(self) -> str:
        """Return the name of the kernel that is being compiled; "" if there is none."""
        names = self._under_way
        return names[0].removeprefix("panoptic_ros.") if names else ""

    def close(self) -> None:
        """Stop monitoring."""
        self._stack.close()

    def _begins(self, kernel: str) -> None:
        self._under_way = [*self._under_way, kernel]
        if not kernel.startswith("panoptic_ros."):
            return
        if not self._logged:
            self._logged = True
            self._logger.warning(TEXT)
        now_s = self._clock()
        if now_s - self._told_s >= TELL_S:
            self._told_s = now_s
            self._tell()

    def _ends(self) -> None:
        self._under_way = self._under_way[:-1]


Extras = Callable[[Node, str, SkeletonModel], Mapping[str, Any]]  # extras of the stage context


class StageNode(GatheringNode):
    """Node that runs one or more connected stages of `graph.nodes.NODES`.

    Records pass from stage to stage without conversion. Messages are made for topics that leave the process
    or have a subscriber. The node waits for the latched rig and skeleton model, then builds the stages. A
    message with bad content is counted, reported on /diagnostics and dropped. Any other error ends the node
    (see `fault`).

    The node declares the parameters of the stages' configurations, as `<stage>.<name>` if it has several
    stages. It selects inputs as in `nodes.stages.inputs.InputChoice`.

    Parameters:
        flow: live or replay, see `graph.flow`.
        replay_window: See `graph.flow`.
        cameras: Names of the cameras to use. Empty: all cameras of the rig.
        graph: All stages that run in the graph, and the ports that their parameters switch on. Empty: those
            of this node.
        shifts: "camera or topic=ns", see `graph.host.Lane` (replay).

    Args:
        stages: Names.
        extras: By stage: a function (node, prefix of its parameters, skeleton) -> extras of the stage
            context.
        own: Cameras that the node reads itself. Their images are published only for subscribers.
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
        live = self._flow.name == "live"
        self._cameras = self._names("cameras")
        graph = self._names("graph")
        shifts = {name: int(ns) for name, ns in named_words("shifts", self._names("shifts")).items()}
        self.prefixes = {stage: f"{stage}." if len(names) > 1 else "" for stage in names}
        configs = {
            stage: declare_config(
                self, resolve(NODES[stage].config), live_defaults(self._flow.name, stage), prefix
            )
            for stage, prefix in self.prefixes.items()
        }
        used = {*graph, *ports_in_use(configs)}
        everywhere = [stage for stage in NODES if stage in {*graph, *names}]
        self._chosen = StageSelection(configs, everywhere, used, shifts)
        self._work: StageWork | None = None  # set when rig and skeleton model have arrived
        self._fault: PanopticError | None = None
        self._tally = Tally(self.get_logger(), names)
        choice = InputChoice(self, Wiring(names, table=rows_in_use(used)).inputs, graph)
        self._health = NodeHealth(self.get_name(), self._tally.statistics, live=live)
        self._diagnostics = Diagnostics(self, self._health, self._look)
        self._compilation = Compilation(self.get_logger(), self._diagnostics.publish)
        reports = reports_of(self, Wiring(names))
        self._diagnostics.more = lambda: [
            status for report in reports.values() for status in report.statuses()
        ]
        self._diagnostics.events = lambda: self._tally.events
        self._worker = Worker(
            lambda batch: self._at_work.do(batch),
            lambda count: self._tally.dropped(self._tally.first, "queue_full", count),
            lambda: self._at_work.fetch(),
        )
        self.together = SubscriptionPoller(self, self._worker.at_once)
        self._reading = OwnCameraReader(
            self,
            self._flow,
            own,
            lambda entry, record: self._at_work.put_own(entry, record),
            lambda key: self._at_work.end(key),
            lambda notice: self._tally.tell(self._tally.first, notice),
        )
        ends = StreamEnds(self, lambda topic: self._worker.note(lambda: self._at_work.topic_over(topic)))
        self._kept = StateExchange(self, names, self._hand_over, self._tally.has_taken) if live else None
        self._rig_changes = RigChanges(self, self._cameras, self._worker.note, self._change_rig)
        self._facts = FactsSubscriber(
            self,
            self._begin,
            lambda error: self._tally.refuse(self._tally.first, error),
            lambda rig: self._rig_changes.offer(rig, self._facts.rig),
            needs_cameras=not all(port.optional for stage in names for port in NODES[stage].inputs),
        )
        self._surroundings = NodeParts(
            self,
            self._flow,
            choice,
            self._reading,
            self._worker,
            self._tally,
            self._facts,
            self._health,
            self._diagnostics,
            reports,
            ends,
            self._kept,
            PauseService(self) if live else None,
        )

    def _names(self, parameter: str) -> list[str]:
        return list(self.declare_parameter(parameter, Parameter.Type.STRING_ARRAY).value or [])

    @property
    def _at_work(self) -> StageWork:
        """Return the stages, which exist before the worker starts and before messages arrive."""
        assert self._work is not None
        return self._work

    @property
    def fault(self) -> PanopticError | None:
        """Return the error that ended this node; None if there was none."""
        return self._fault or self._worker.fault

    @property
    def healthy(self) -> bool:
        """Return False after a fault or a bug."""
        return self._fault is None and self._worker.alive

    @property
    def configs(self) -> Mapping[str, Config]:
        """Return the configuration of each stage."""
        return self._chosen.configs

    @property
    def statistics(self) -> Mapping[str, StageStatistics]:
        """Return the counters of each stage."""
        return self._tally.statistics

    def close(self) -> None:
        """Stop the worker and the camera readers."""
        if self._work is not None:
            self._work.close()
        self._reading.close()
        self._worker.stop()
        self._compilation.close()

    def _look(self) -> None:
        """Update the current activity of the stages for /diagnostics."""
        stage, since_ns = self._work.pipeline.stepping if self._work is not None else ("", 0)
        self._health.doing = Activity(stage, since_ns, self._compilation.kernel)
        self._health.awaited, self._health.unfit = self._facts.missing, self._facts.unfit

    def _begin(self, rig: Rig, skeleton: SkeletonModel) -> None:
        def start(states: Mapping[str, bytes]) -> None:
            try:
                self._start(rig, skeleton, states)
            except PanopticError as error:
                self._fail(error)

        if self._kept is None:
            start({})
        else:
            self._kept.when_known(start)

    def _start(self, rig: Rig, skeleton: SkeletonModel, states: Mapping[str, bytes]) -> None:
        extras: dict[str, Any] = {}
        for stage, prefix in self.prefixes.items():
            if stage in self._extras:
                extras |= self._extras[stage](self, prefix, skeleton)
        context = StageContext(self._used(rig), skeleton, extras)
        self._work = StageWork(self._surroundings, self._chosen, context)
        self._work.start(states, self._fail)

    def _used(self, rig: Rig) -> Rig:
        return rig.subset(self._cameras) if self._cameras else rig

    def _fail(self, error: PanopticError) -> None:
        self._fault = error

    def _hand_over(self) -> None:
        """Publish the states of the stages for the keeper, between two records."""
        kept = self._kept
        if kept is not None:
            self._worker.note(lambda: self._at_work.publish_states(kept))

    def _change_rig(self, rig: Rig) -> Sequence[str]:
        return self._at_work.change_rig(rig, self._used(rig))
