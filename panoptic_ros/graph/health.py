"""How a node and its stages are, in words and numbers: what /diagnostics tells.

How the whole graph is, from what its nodes say of themselves, and from who has gone silent.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from panoptic_ros.graph.arrivals import SECOND, Arrivals
from panoptic_ros.graph.counters import StageStatistics

CALM_NS = 10 * SECOND  # so long after the last drop or notice, a warning clears
STALLED_NS = SECOND  # in one step
RATE_NS = 5 * SECOND  # over which rates are told


class Status(NamedTuple):
    """One status.

    Args:
        name: of the stage, or node; "<node>: <camera> <topic>" for an input.
        trouble: what is wrong; "" = all is well.
        owner: camera, sensor or device.
    """

    name: str
    trouble: str
    owner: str
    values: Mapping[str, str]


@dataclass(frozen=True)
class Told:
    """A status of a graph as somebody heard it.

    Args:
        namespace: of its graph; "" = none. name: without prefix and namespace.
        trouble: "" if all is well. heard_s: a moment of a monotonic clock.
    """

    namespace: str
    name: str
    trouble: str
    values: Mapping[str, str]
    heard_s: float


class Doing(NamedTuple):
    """What the stages are at: the stage in whose step they are, and since when; what is being compiled."""

    stage: str = ""
    since_ns: int = 0
    kernel: str = ""


@dataclass
class _Changes:
    """When counters went up last, and by how much since all was calm."""

    seen: Counter[str] = field(default_factory=Counter)
    newest_ns: dict[str, int] = field(default_factory=dict)
    calm: dict[str, int] = field(default_factory=dict)  # counts when it was calm last

    def recent(self, counts: Mapping[str, int], now_ns: int) -> dict[str, int]:
        """How much each counter has gone up since all was calm, of those that went up of late."""
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
    drops: _Changes = field(default_factory=_Changes)
    warnings: _Changes = field(default_factory=_Changes)
    taken: int = 0
    newest_ns: int | None = None  # when `taken` was seen to go up
    seen: deque[tuple[int, int]] = field(default_factory=deque)  # time and `taken`, of the last seconds

    def rate_hz(self, now_ns: int) -> float:
        """Records per second of late."""
        self.seen.append((now_ns, self.statistics.taken))
        while len(self.seen) > 2 and now_ns - self.seen[0][0] > RATE_NS:
            self.seen.popleft()
        (begun_ns, before), (ended_ns, after) = self.seen[0], self.seen[-1]
        return SECOND * (after - before) / max(1, ended_ns - begun_ns)


class Health:
    """The statuses of a node. Times are of one monotonic clock, ns.

    Args:
        node: its name. statistics: by stage. live: whether silence is an outage; a recording has its pauses.
    """

    def __init__(self, node: str, statistics: Mapping[str, StageStatistics], live: bool):
        self._node, self._live = node, live
        self._stages = {name: _StageHealth(own) for name, own in statistics.items()}
        self._inputs: list[tuple[Arrivals, str]] = []
        self.awaited: Sequence[str] = ()  # latched facts that have not come
        self.unfit: Sequence[str] = ()  # why the newest latched facts are not worked with
        self.doing = Doing()
        self.finished = False

    def add(self, arrivals: Arrivals, stage: str) -> None:
        """One more input, and the first stage that takes it."""
        self._inputs.append((arrivals, stage))

    def statuses(self, now_ns: int, briefly: bool = False) -> list[Status]:
        """Of all stages, then of all inputs; briefly: without values."""
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
        reasons += [f"dropped of late: {', '.join(told)}"] if told else []
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
        """In a word, and what is wrong with it."""
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
SILENT_NS = 5 * SECOND // 2  # nodes tell of themselves once a second
NAMED = 4  # troubles in the message


@dataclass
class _Heard:
    newest_ns: int
    finished: bool = False
    troubles: dict[str, str] = field(default_factory=dict)  # by status


class GraphHealth:
    """One status for all nodes of a graph. Times are of one monotonic clock, ns."""

    def __init__(self) -> None:
        self._nodes: dict[str, _Heard] = {}

    def heard(self, name: str, values: Mapping[str, str], trouble: str, now_ns: int) -> None:
        """A status of a node has come.

        Args:
            name: of the status, without prefix and namespace. trouble: its message, "" if all is well.
        """
        node = values.get("node")
        if node is None:
            return
        known = self._nodes.setdefault(node, _Heard(now_ns))
        known.newest_ns = now_ns
        if "finished" in values:
            known.finished = values["finished"] == "true"
        if trouble:
            known.troubles[name] = trouble
        else:
            known.troubles.pop(name, None)

    def statuses(self, now_ns: int) -> list[Status]:
        """The one status."""
        silent = {
            node: (now_ns - heard.newest_ns) / SECOND
            for node, heard in self._nodes.items()
            if now_ns - heard.newest_ns > SILENT_NS and not heard.finished
        }
        gone = [f"node {node} has not been heard for {age:.1f} s" for node, age in silent.items()]
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
