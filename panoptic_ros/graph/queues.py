"""Queues of a node: how records wait for the stages, and which are taken next when the node falls behind.

`Companions` holds live records that wait for other records of the same camera, e.g. images that wait for
depth maps.
"""

from __future__ import annotations

from collections import OrderedDict, defaultdict, deque
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

from panoptic_ros.graph.flow import BUSY, PATIENT, Flow
from panoptic_ros.graph.nodes import Port
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.graph.wiring import Wiring


class QueuedMessage(NamedTuple):
    """Message that has arrived on a topic of a camera or device, with its time of arrival (monotonic, ns)."""

    topic: str
    owner: str
    stamp_ns: int
    message: Any
    came_ns: int = 0


@dataclass
class _CompanionQueue:
    """Waiting companions of one topic."""

    port: Port
    waiting: deque[QueuedMessage] = field(default_factory=deque)


class Companions:
    """Combination of records with their companions; the records of a camera stay in order.

    A record waits until each companion topic of its camera has delivered a late enough companion. It also
    stops waiting when a record arrives that is later by more than the patience of the port.

    Args:
        ports: Ports of the companions, with their `patience_ns` and `ahead_ns`.
        present: Existing (topic, owner).
    """

    def __init__(self, ports: Sequence[Port], present: Collection[tuple[str, str]]):
        self._beside: dict[str, list[_CompanionQueue]] = {}
        self._records: dict[str, deque[QueuedMessage]] = {}
        topics = {port.topic: port for port in ports}
        for topic, owner in sorted(present):
            if topic in topics:
                self._beside.setdefault(owner, []).append(_CompanionQueue(topics[topic]))
                self._records[owner] = deque()

    def put(self, item: QueuedMessage) -> list[tuple[QueuedMessage, ...]]:
        """Add an item; return the bundles that are ready, each with the record after its companions."""
        if item.owner not in self._beside:
            return [(item,)]
        for beside in self._beside[item.owner]:
            if beside.port.topic == item.topic:
                self._keep(beside, item)
                return self._ready(item.owner, None)
        self._records[item.owner].append(item)
        return self._ready(item.owner, item.stamp_ns)

    def _keep(self, beside: _CompanionQueue, item: QueuedMessage) -> None:
        """Add a companion, and drop old ones: they must not pile up if the camera sends no records."""
        waiting = beside.waiting
        while waiting and not 0 <= item.stamp_ns - waiting[0].stamp_ns <= beside.port.patience_ns:
            waiting.popleft()
        waiting.append(item)

    def _ready(self, owner: str, newest_ns: int | None) -> list[tuple[QueuedMessage, ...]]:
        records, found = self._records[owner], []
        while records and all(_has_come(b, records[0].stamp_ns, newest_ns) for b in self._beside[owner]):
            record = records.popleft()
            early = [item for b in self._beside[owner] for item in _before(b, record.stamp_ns)]
            found.append((*early, record))
        return found


def _has_come(beside: _CompanionQueue, stamp_ns: int, newest_ns: int | None) -> bool:
    """Return whether the wait for companions of a record is over."""
    late = newest_ns is not None and newest_ns - stamp_ns >= beside.port.patience_ns
    return late or any(item.stamp_ns > stamp_ns - beside.port.ahead_ns for item in beside.waiting)


def _before(beside: _CompanionQueue, stamp_ns: int) -> list[QueuedMessage]:
    """Remove and return the companions that are passed on before a record."""
    found = []
    while beside.waiting and beside.waiting[0].stamp_ns < stamp_ns + beside.port.ahead_ns:
        found.append(beside.waiting.popleft())
    return found


PERIODS = 3  # frame periods without a frame, after which a camera has failed
LONGEST_NS = 2_000_000_000  # 2 s; a longer time between frames is a pause, not a period


class MessageQueue(Protocol):
    """Queue between the callbacks of a node and its worker. Not thread-safe."""

    def put(self, key: str, stamp_ns: int, item: Any) -> int:
        """Add an item of a topic; return how many items were dropped for it."""

    def take(self) -> list[Any]:
        """Remove and return the next items to process, in order; [] if there are none."""


class FifoQueue:
    """First-in-first-out queue that drops the oldest item of a topic above the limit of the topic.

    Args:
        limit_of: Returns the most waiting items of a topic, by its key. None: no limit.
        in_runs: Keys of topics whose consecutive items are taken together.
    """

    def __init__(
        self, limit_of: Callable[[str], int | None] = lambda key: None, in_runs: Collection[str] = ()
    ):
        self._limit_of, self._in_runs = limit_of, frozenset(in_runs)
        self._items: OrderedDict[int, tuple[str, Any]] = OrderedDict()  # by number, in order of arrival
        self._numbers: defaultdict[str, deque[int]] = defaultdict(deque)  # numbers of the items of each topic
        self._newest = 0

    def put(self, key: str, stamp_ns: int, item: Any) -> int:
        """Add an item, see `MessageQueue`."""
        own, limit, dropped = self._numbers[key], self._limit_of(key), 0
        if limit is not None and len(own) >= limit:
            del self._items[own.popleft()]
            dropped = 1
        self._newest += 1
        own.append(self._newest)
        self._items[self._newest] = key, item
        return dropped

    def take(self) -> list[Any]:
        """Remove and return the next items, see `MessageQueue`."""
        if not self._items:
            return []
        found = []
        while self._items:
            _, (key, item) = self._items.popitem(last=False)
            self._numbers[key].popleft()
            found.append(item)
            following = next((other for other, _ in self._items.values()), "")
            if not {key, following} <= self._in_runs:
                break
        return found


class InstantQueue:
    """Queue that gives all other items in order first, and then images as instants.

    Args:
        instants: Queue of the topics `keys`.
        keys: Topics of images.
        others: Queue of all other topics.
        full: Returns whether no further instant may begin yet.
    """

    def __init__(
        self,
        instants: MessageQueue,
        keys: Collection[str],
        others: MessageQueue,
        full: Callable[[], bool] = lambda: False,
    ):
        self._instants, self._keys, self._others, self._full = instants, frozenset(keys), others, full

    def put(self, key: str, stamp_ns: int, item: Any) -> int:
        """Add an item, see `MessageQueue`."""
        return (self._instants if key in self._keys else self._others).put(key, stamp_ns, item)

    def take(self) -> list[Any]:
        """Remove and return the next items, see `MessageQueue`."""
        return self._others.take() or ([] if self._full() else self._instants.take())


class NewestInstantQueue:
    """Queue for a detector that cannot keep up: it gives the newest views of one instant together.

    If each camera dropped frames independently, the remaining frames would belong to different instants. No
    person would then be seen by two views at one instant.

    Args:
        cameras: Names.
        depth: Most frames per camera.
        patience_ns: A camera is not waited for if its newest frame is older than the newest of all by this
            time. For slow cameras, the time is `PERIODS` frame periods.
    """

    def __init__(self, cameras: Sequence[str], depth: int = 4, patience_ns: int = 500_000_000):
        self._frames: dict[str, deque[tuple[int, Any]]] = {name: deque() for name in cameras}
        self._seen: dict[str, int] = dict.fromkeys(cameras, -1)
        self._periods: dict[str, int] = dict.fromkeys(cameras, 0)
        self._depth = depth
        self._patience_ns = patience_ns
        self._dropped = 0

    def put(self, key: str, stamp_ns: int, item: Any) -> int:
        """Add an item, see `MessageQueue`."""
        frames = self._frames[key]
        frames.append((stamp_ns, item))
        if self._seen[key] >= 0:
            self._periods[key] = min(stamp_ns - self._seen[key], LONGEST_NS)
        self._seen[key] = stamp_ns
        dropped, self._dropped = self._dropped, 0
        if len(frames) > self._depth:
            frames.popleft()
            dropped += 1
        return dropped

    def take(self) -> list[Any]:
        """Remove and return the frames of one instant.

        The instant is the newest timestamp that all active cameras have reached. Each active camera gives its
        nearest frame.
        """
        newest = max(self._seen.values())
        living = [name for name, stamp in self._seen.items() if newest - stamp <= self._patience(name)]
        if newest < 0 or any(not self._frames[name] for name in living):
            return []
        instant = min(self._frames[name][-1][0] for name in living)
        return [self._nearest(name, instant) for name in living]

    def _patience(self, camera: str) -> int:
        return max(self._patience_ns, PERIODS * self._periods[camera])

    def _nearest(self, camera: str, instant: int) -> Any:
        frames = self._frames[camera]
        while len(frames) > 1 and abs(frames[1][0] - instant) <= abs(frames[0][0] - instant):
            frames.popleft()
            self._dropped += 1
        return frames.popleft()[1]


def queue_for(
    wiring: Wiring,
    flow: Flow,
    present: Collection[tuple[str, str]],
    full: Callable[[], bool] = lambda: False,
) -> MessageQueue:
    """Return the queue of a node.

    Live: images wait as instants. Other topics keep a few messages, IMUs more, and topics where every message
    counts keep all. Replay: one queue without limit.

    Args:
        present: (topic, owner) of the inputs.
        full: Returns whether no further instant may begin yet.
    """
    if flow.queue_limit is None:
        return FifoQueue()
    kinds = {
        topic: {wiring.specs[reader.stage].queue for reader in readers}
        for topic, readers in wiring.readers.items()
    }
    limits = {
        topic: PATIENT if kind == {"all"} else BUSY if kind == {"late"} else flow.queue_limit
        for topic, kind in kinds.items()
    }
    frequent = [f"{topic} {owner}" for topic, owner in present if TOPICS[topic].scope == "imu"]
    others = FifoQueue(lambda key: limits[key.split(" ")[0]], frequent)
    beside = {port.topic for port in wiring.inputs if port.patience_ns}
    instants = [
        f"{topic} {owner}" for topic, owner in present if "instant" in kinds[topic] and topic not in beside
    ]
    return InstantQueue(NewestInstantQueue(instants), instants, others, full) if instants else others
