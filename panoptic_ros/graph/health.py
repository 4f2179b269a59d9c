"""Health of a node, its stages and inputs, and of the whole graph, as published on /diagnostics.

`NodeHealth` derives the statuses of one node. `GraphHealth` combines the statuses of all nodes and reports
silent nodes.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from panoptic_ros.graph.arrivals import SECOND, ArrivalCounters
from panoptic_ros.graph.counters import StageStatistics

CALM_NS = 10 * SECOND  # 10 s; a warning clears this long after the last drop or notice
STALLED_NS = SECOND  # 1 s; a stage is stalled if one step takes longer
RATE_NS = 5 * SECOND  # 5 s; window of rates


class Status(NamedTuple):
    """Diagnostic status of a stage, node or input.

    Args:
        name: Stage or node, or "<node>: <camera> <topic>" for an input.
        trouble: Description of the problem. "": no problem.
        owner: Camera, sensor or device.
        values: Further values as text.
    """

    name: str
    trouble: str
    owner: str
    values: Mapping[str, str]


@dataclass(frozen=True)
class ReceivedStatus:
    """Diagnostic status of a graph as a listener received it.

    Args:
        namespace: Namespace of the graph. "": none.
        name: Without prefix and namespace.
        trouble: Description of the problem. "": no problem.
        values: Further values as text.
        heard_s: Time of arrival on a monotonic clock.
    """

    namespace: str
    name: str
    trouble: str
    values: Mapping[str, str]
    heard_s: float


class Activity(NamedTuple):
    """Current activity: the stage that performs a step, its start time, and the kernel being compiled."""

    stage: str = ""
    since_ns: int = 0
    kernel: str = ""


@dataclass
class _CounterChanges:
    """Recent increases of counters, relative to their value before the increases began."""

    seen: Counter[str] = field(default_factory=Counter)
    newest_ns: dict[str, int] = field(default_factory=dict)
    calm: dict[str, int] = field(default_factory=dict)  # counts at the end of the last calm period

    def recent(self, counts: Mapping[str, int], now_ns: int) -> dict[str, int]:
        """Return how much each recently increased counter has grown since it was last calm."""
        found = {}
        for name, count in counts.items():
            if count > self.seen[name]:
                if now_ns - self.newest_ns.get(name, -CALM_NS) >= CALM_NS:
                    self.calm[name] = self.seen[name]
                self.newest_ns[name], self.seen[name] = now_ns, count
            if name in self.newest_ns and now_ns - self.newest_ns[name] < CALM_NS:
                found[name] = count - self.calm[name]
        return found


@dataclass
class _StageHealth:
    statistics: StageStatistics
    drops: _CounterChanges = field(default_factory=_CounterChanges)
    warnings: _CounterChanges = field(default_factory=_CounterChanges)
    taken: int = 0
    newest_ns: int | None = None  # time at which `taken` was last found increased
    seen: deque[tuple[int, int]] = field(default_factory=deque)  # (time, `taken`) over the last RATE_NS

    def rate_hz(self, now_ns: int) -> float:
        """Return the recent number of records per second."""
        self.seen.append((now_ns, self.statistics.taken))
        while len(self.seen) > 2 and now_ns - self.seen[0][0] > RATE_NS:
            self.seen.popleft()
        (begun_ns, before), (ended_ns, after) = self.seen[0], self.seen[-1]
        return SECOND * (after - before) / max(1, ended_ns - begun_ns)


class NodeHealth:
    """Statuses of a node. Times are of one monotonic clock, ns.

    Args:
        node: Name of the node.
        statistics: By stage.
        live: Whether silence is an outage. In a recording, pauses are normal.
    """

    def __init__(self, node: str, statistics: Mapping[str, StageStatistics], live: bool):
        self._node, self._live = node, live
        self._stages = {name: _StageHealth(own) for name, own in statistics.items()}
        self._inputs: list[tuple[ArrivalCounters, str]] = []
        self.awaited: Sequence[str] = ()  # latched facts that have not arrived
        self.unfit: Sequence[str] = ()  # reasons why the newest latched facts are not adopted
        self.doing = Activity()
        self.finished = False

    def add(self, arrivals: ArrivalCounters, stage: str) -> None:
        """Add an input, and the first stage that takes it."""
        self._inputs.append((arrivals, stage))

    def statuses(self, now_ns: int, briefly: bool = False) -> list[Status]:
        """Return the statuses of all stages, then of all inputs.

        Args:
            briefly: Whether to omit the values.
        """
        return [self._of_stage(name, now_ns, briefly) for name in self._stages] + [
            Status(
                f"{self._node}: {arrivals.title}",
                arrivals.trouble(now_ns) if self._live else "",
                arrivals.owner,
                {} if briefly else {"node": self._node, "stage": stage, **arrivals.values(now_ns)},
            )
            for arrivals, stage in self._inputs
        ]

    def _of_stage(self, name: str, now_ns: int, briefly: bool) -> Status:
        own = self._stages[name]
        if own.statistics.taken != own.taken:
            own.taken, own.newest_ns = own.statistics.taken, now_ns
        waiting = list(self.awaited)
        if self._live and not waiting:
            waiting = [a.title for a, stage in self._inputs if stage == name and a.is_silent(now_ns)]
        state, trouble = self._state(name, waiting, now_ns)
        drops = own.drops.recent(own.statistics.dropped.copy(), now_ns)
        warned = own.warnings.recent(own.statistics.warned, now_ns)
        told = [f"{count} {cause}" for cause, count in drops.items()]
        reasons = [*([trouble] if trouble else []), *self.unfit]
        reasons += [f"dropped recently: {', '.join(told)}"] if told else []
        reasons += [own.statistics.latest(code) for code in warned]
        title = self._node if len(self._stages) == 1 else name
        if briefly:
            return Status(title, "; ".join(reasons), "", {})
        age = "nan" if own.newest_ns is None else f"{(now_ns - own.newest_ns) / SECOND:.2f}"
        values = {
            "node": self._node,
            "state": state,
            "waiting_for": ", ".join(waiting),
            "rate_hz": f"{own.rate_hz(now_ns):.2f}",
            "age_s": age,
            "compiling": self.doing.kernel,
            **own.statistics.values(),
            "finished": str(self.finished).lower(),
        }
        return Status(title, "; ".join(reasons), "", values)

    def _state(self, name: str, waiting: Sequence[str], now_ns: int) -> tuple[str, str]:
        """Return the state as one word, and a description of its problem."""
        doing = self.doing
        busy_s = (now_ns - doing.since_ns) / SECOND if doing.stage == name else 0.0
        if self.finished:
            return "finished", ""
        if self.awaited:
            return "starting", f"waits for {', '.join(waiting)}"
        if doing.kernel and (busy_s or not doing.stage):
            return "compiling", f"compiles {doing.kernel}"
        if busy_s * SECOND > STALLED_NS:
            return "stalled", f"stalled: {busy_s:.1f} s in one step"
        if waiting:
            return "waiting", f"waits for {', '.join(waiting)}"
        return "running", ""


NAME = "graph"
SILENT_NS = 5 * SECOND // 2  # 2.5 s; nodes publish their statuses once a second
NAMED = 4  # most problems in the message


@dataclass
class _NodeStatus:
    newest_ns: int
    finished: bool = False
    troubles: dict[str, str] = field(default_factory=dict)  # by status name


class GraphHealth:
    """Combined status of all nodes of a graph. Times are of one monotonic clock, ns."""

    def __init__(self) -> None:
        self._nodes: dict[str, _NodeStatus] = {}

    def heard(self, name: str, values: Mapping[str, str], trouble: str, now_ns: int) -> None:
        """Take a status of a node.

        Args:
            name: Name of the status, without prefix and namespace.
            values: Its values as text.
            trouble: Its message. "" if there is no problem.
        """
        node = values.get("node")
        if node is None:
            return
        known = self._nodes.setdefault(node, _NodeStatus(now_ns))
        known.newest_ns = now_ns
        if "finished" in values:
            known.finished = values["finished"] == "true"
        if trouble:
            known.troubles[name] = trouble
        else:
            known.troubles.pop(name, None)

    def statuses(self, now_ns: int) -> list[Status]:
        """Return the combined status."""
        silent = {
            node: (now_ns - heard.newest_ns) / SECOND
            for node, heard in self._nodes.items()
            if now_ns - heard.newest_ns > SILENT_NS and not heard.finished
        }
        gone = [f"no message from node {node} for {age:.1f} s" for node, age in silent.items()]
        others = [
            f"{name}: {trouble}"
            for node, heard in self._nodes.items()
            if node not in silent
            for name, trouble in heard.troubles.items()
        ]
        told = gone + others
        more = [f"and {len(told) - NAMED} more"] if len(told) > NAMED else []
        values = {
            "nodes": str(len(self._nodes)),
            "silent": ", ".join(silent),
            "warnings": str(len(told)),
        }
        return [Status(NAME, "; ".join(told[:NAMED] + more), "", values)]
