"""Replays bags onto the live graph, at any rate and from any topic on, with the bag's time on /clock.

The module also selects the topics, so that all stages from a given one on compute their output again.
"""

from __future__ import annotations

import fnmatch
import heapq
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from rclpy.executors import SingleThreadedExecutor
from rclpy.utilities import try_shutdown

from panoptic_ros.errors import DataError, EnvironmentProblem, UsageError
from panoptic_ros.graph.nodes import NODES
from panoptic_ros.graph.topics import TOPICS, variants
from panoptic_ros.io.bag_connections import Connection
from panoptic_ros.io.bags import BagReader
from panoptic_ros.io.cdr_heads import stamp_in, with_stamp
from panoptic_ros.io.interruption import first_request_told
from panoptic_ros.nodes.middleware.runtime import start_ros
from panoptic_ros.nodes.sources.replay_node import ReplayNode, is_latched
from panoptic_ros.running.processes.children import prepare_environment


def topics_from(begin: str) -> frozenset[str]:
    """Return the keys of the topics that a graph needs when it starts at a given topic.

    These are the topic itself, topics that later stages take from elsewhere, and latched topics. Stages and
    ports that are off by default are ignored.

    Args:
        begin: key of a topic, e.g. detections, or the name of the stage that publishes it.

    Raises:
        UsageError: if there is no such topic or stage.
    """
    keys = set(NODES[begin].outputs) if begin in NODES else {begin}
    if begin not in NODES and begin not in TOPICS:
        raise UsageError(
            f"--from {begin}: there is no such topic or stage; topics are {', '.join(TOPICS)}, stages "
            f"{', '.join(NODES)}"
        )
    given, taken = set(keys), set[str]()
    for spec in NODES.values():  # in the order in which records pass through the stages
        ports = {port.topic for port in spec.inputs if not port.switch}
        if ports & given and not spec.switch:
            given |= set(spec.outputs)
            taken |= ports
    made = {
        key for spec in NODES.values() for key in spec.outputs
    }  # stages make these again, if not recorded
    latched = {key for key, topic in TOPICS.items() if topic.latched and (topic.recorded or key not in made)}
    wanted = keys | (taken - given) | latched
    return frozenset(wanted | {variant for key in wanted for variant in variants(key)})


def chosen_topics(topics: Mapping[str, str], keys: Collection[str]) -> list[str]:
    """Return the topics of a bag that carry the given topics of the graph, in any namespace.

    Args:
        topics: message type by name, for all topics of the bag.
        keys: keys of the topics of the graph.
    """
    return [name for name, kind in topics.items() if key_of(name, kind) in keys]


def key_of(name: str, kind: str) -> str:
    """Return the key of the graph topic that a topic of a bag carries, in any namespace; "" = none.

    Args:
        name: name of the bag's topic.
        kind: its message type.
    """
    rows = {key: row for key, row in TOPICS.items() if row.message == kind}
    endings = {key: "/" + row.name.split("{owner}/")[-1] for key, row in rows.items()}
    found = [key for key, ending in endings.items() if name.endswith(ending)]
    return max(found, key=lambda key: len(endings[key]), default="")


SECOND = 1_000_000_000
CLOCK_PERIOD_S = 0.005  # s of real time between /clock messages; the maximum delay of a node on that clock
DISCOVERY_S = 1.0  # s, time to discover existing subscribers
BEHIND_S = 0.1  # s, delay of a replay that is reported to the user


@dataclass(frozen=True)
class ReplayOptions:
    """Options of a replay.

    Args:
        rate: Bag time over real time, s/s.
        begin: Key of a topic or name of a stage; "" = all topics.
        patterns: Shell patterns of full topic names. They further restrict the topics that `begin` selects.
        start_s: Start of the replay, s from the start of the bag.
        duration_s: Duration, s of bag time; None = to the end.
        clock: Whether to publish /clock.
        space: Namespace of the published topics.
        loops: Number of repetitions; 0 = until a request to end.
        wait_s: Maximum wait for the first subscriber before the replay begins, s.
    """

    rate: float = 1.0
    begin: str = ""
    patterns: Sequence[str] = ()
    start_s: float = 0.0
    duration_s: float | None = None
    clock: bool = False
    space: str = ""
    loops: int = 1
    wait_s: float = 0.0


@dataclass(frozen=True)
class ReplayResult:
    """Result of a replay.

    Args:
        count: number of published messages.
        topics: published topics.
        behind_s: maximum delay of a message, s.
    """

    count: int
    topics: tuple[str, ...]
    behind_s: float


def replay(paths: Sequence[Path], options: ReplayOptions, tell: Callable[[str], None]) -> ReplayResult:
    """Publish the messages of bags at their times, until the end or a request to end.

    Args:
        tell: callback with lines for the user: topics that are left out, a machine that is too slow.

    Raises:
        DataError: if a bag cannot be read, or has none of the topics.
        EnvironmentProblem: if there is no subscriber within `wait_s`.
    """
    with ExitStack() as stack:
        asked = stack.enter_context(first_request_told())
        bags = [stack.enter_context(BagReader(path)) for path in paths]
        connections = _connections(bags, options)
        prepare_environment()
        start_ros([])
        stack.callback(try_shutdown)
        node = ReplayNode(connections, options.space, options.clock, tell)
        stack.callback(node.destroy_node)
        if not node.topics:
            raise DataError("none of the topics can be published here")
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        stack.callback(executor.shutdown)
        player = _Player(node, executor, bags, connections, options, asked)
        player.wait()
        loop = 0
        while not asked() and (not options.loops or loop < options.loops):
            player.play(loop)
            loop += 1
        node.wait_for_arrival()
        node_topics = node.topics
    if player.behind_s > BEHIND_S:
        tell(f"messages were up to {player.behind_s:.2f} s late: too much for this machine at this rate")
    return ReplayResult(player.count, node_topics, player.behind_s)


def _connections(bags: Sequence[BagReader], options: ReplayOptions) -> list[Connection]:
    """Return the topics to replay.

    Raises:
        DataError: if there are none, or a topic is in two bags.
    """
    found: dict[str, Connection] = {}
    for bag in bags:
        names = list(bag.topics)
        if options.begin:
            names = chosen_topics(bag.topics, topics_from(options.begin))
        for name in names:
            if options.patterns and not any(fnmatch.fnmatchcase(name, p) for p in options.patterns):
                continue
            if not bag.counts[name] or (bag.is_outdated(name) and not bag.can_be_brought_up(name)):
                continue
            if name in found and not is_latched(found[name]):
                raise DataError(f"topic {name} is in more than one of the bags; choose with --topic")
            found[name] = bag.connection(name)
    data = [connection for connection in found.values() if not is_latched(connection)]
    if not data:
        there = ", ".join(sorted({topic for bag in bags for topic in bag.topics})) or "no topics"
        places = " and ".join(str(bag.path) for bag in bags)
        raise DataError(f"{places} has no such topics; there are {there}")
    return list(found.values())


class _Player:
    def __init__(
        self,
        node: ReplayNode,
        executor: SingleThreadedExecutor,
        bags: Sequence[BagReader],
        connections: Sequence[Connection],
        options: ReplayOptions,
        stop: Callable[[], bool],
    ):
        self._node, self._executor, self._bags = node, executor, bags
        self._options, self._stop = options, stop
        self._latched = {c.topic for c in connections if is_latched(c)}
        stamps = [
            stamp
            for bag in bags
            for _, stamp, _, _ in bag.first(*(t for t in node.topics if t not in self._latched))
        ]
        if not stamps:
            raise DataError("only latched topics can be published here; install the messages of the others")
        self._first_ns = min(stamps) + round(options.start_s * SECOND)
        self._stamped = {connection.topic for connection in connections if connection.has_header}
        length = options.duration_s or max(bag.length_s for bag in bags) - options.start_s
        most = max(bag.counts[topic] for bag in bags for topic in bag.topics)
        # one message period longer than the recording
        self._span_ns = round(max(length, 0.0) * (1 + 1 / max(1, most - 1)) * SECOND)
        self._shift_ns = 0
        self.count, self.behind_s = 0, 0.0

    def wait(self) -> None:
        """Publish the latched messages, which nodes need first, then wait for subscribers.

        The wait takes at least `DISCOVERY_S`, so that existing subscribers are discovered.

        Raises:
            EnvironmentProblem: if no node subscribes to the other topics in time.
        """
        for stamp, topic, data in self._messages(self._latched):
            if stamp <= self._first_ns:
                self._node.publish(topic, data)
                self.count += 1
        data_topics = set(self._node.topics) - self._latched
        begin = time.monotonic()
        while not self._stop():
            self._executor.spin_once(timeout_sec=0.05)
            passed = time.monotonic() - begin
            if passed >= DISCOVERY_S and (self._node.heard(data_topics) or passed >= self._options.wait_s):
                break
        if self._options.wait_s and not self._node.heard(data_topics) and not self._stop():
            raise EnvironmentProblem(
                f"no node subscribes to any topic within {self._options.wait_s:g} s: is the graph running, "
                "in this ROS_DOMAIN_ID and --namespace?"
            )

    def play(self, loop: int) -> None:
        """Publish all messages once, from the start to the end.

        From the second loop on, header timestamps and the clock continue to increase, as those of running
        devices do.
        """
        options = self._options
        self._shift_ns = loop * self._span_ns
        first = self._first_ns
        last = None if options.duration_s is None else first + round(options.duration_s * SECOND)
        begin = time.monotonic()
        for stamp, topic, data in self._messages(set(self._node.topics)):
            if last is not None and stamp >= last:
                break
            if stamp < first or (stamp == first and topic in self._latched):
                continue  # it is published already, or lies before the start
            self._sleep_until(stamp, first, begin)
            if self._stop():
                return
            stamp_ns = stamp_in(data) if self._shift_ns and topic in self._stamped else None
            if stamp_ns is not None:
                data = with_stamp(data, stamp_ns + self._shift_ns)
            self._node.publish(topic, data)
            self.count += 1
        self._node.tell_time(self._now(first, begin))

    def _messages(self, topics: Collection[str]) -> Iterator[tuple[int, str, bytes]]:
        """Yield the messages of all bags in order of their recording times."""
        rows = [
            ((stamp, topic, data) for topic, stamp, data, _ in bag.raw(*(set(topics) & set(bag.topics))))
            for bag in self._bags
            if set(topics) & set(bag.topics)
        ]
        return heapq.merge(*rows, key=lambda row: row[0])

    def _now(self, first_ns: int, begin: float) -> int:
        """Return the current bag time, ns."""
        return self._shift_ns + first_ns + round((time.monotonic() - begin) * self._options.rate * SECOND)

    def _sleep_until(self, stamp_ns: int, first_ns: int, begin: float) -> None:
        due = begin + (stamp_ns - first_ns) / SECOND / self._options.rate
        while (left := due - time.monotonic()) > 0 and not self._stop():
            self._node.tell_time(self._now(first_ns, begin))
            self._executor.spin_once(timeout_sec=min(left, CLOCK_PERIOD_S))
        self._node.tell_time(self._shift_ns + stamp_ns)
        self.behind_s = max(self.behind_s, -left)
