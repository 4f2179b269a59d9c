"""What a node keeps waiting, and what it takes next when it falls behind.

How what comes to a node waits for its stages.

Live: records that wait for others of the same camera, e.g. images for their depth maps.
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


class Item(NamedTuple):
    """What has come on a topic of a camera or device, and when, on the monotonic clock."""

    topic: str
    owner: str
    stamp_ns: int
    message: Any
    came_ns: int = 0


@dataclass
class _Beside:
    """The companions of one topic that wait for their record."""

    port: Port
    waiting: deque[Item] = field(default_factory=deque)


class Companions:
    """Puts records and their companions together; the records of a camera stay in order.

    A record waits until every companion topic of its camera has shown one that is late enough, or a record
    has come that is later by more than the patience of the port.

    Args:
        ports: of the companions, each with a patience and the time by which it is handed over ahead.
        present: (topic, owner) that there are.
    """

    def __init__(self, ports: Sequence[Port], present: Collection[tuple[str, str]]):
        self._beside: dict[str, list[_Beside]] = {}
        self._records: dict[str, deque[Item]] = {}
        topics = {port.topic: port for port in ports}
        for topic, owner in sorted(present):
            if topic in topics:
                self._beside.setdefault(owner, []).append(_Beside(topics[topic]))
                self._records[owner] = deque()

    def put(self, item: Item) -> list[tuple[Item, ...]]:
        """Take what has come; gives what is ready, each record behind its companions."""
        if item.owner not in self._beside:
            return [(item,)]
        for beside in self._beside[item.owner]:
            if beside.port.topic == item.topic:
                self._keep(beside, item)
                return self._ready(item.owner, None)
        self._records[item.owner].append(item)
        return self._ready(item.owner, item.stamp_ns)

    def _keep(self, beside: _Beside, item: Item) -> None:
        """Add a companion; those of a camera whose records fail must not pile up."""
        waiting = beside.waiting
        while waiting and not 0 <= item.stamp_ns - waiting[0].stamp_ns <= beside.port.patience_ns:
            waiting.popleft()
        waiting.append(item)

    def _ready(self, owner: str, newest_ns: int | None) -> list[tuple[Item, ...]]:
        records, found = self._records[owner], []
        while records and all(_has_come(b, records[0].stamp_ns, newest_ns) for b in self._beside[owner]):
            record = records.popleft()
            early = [item for b in self._beside[owner] for item in _before(b, record.stamp_ns)]
            found.append((*early, record))
        return found


def _has_come(beside: _Beside, stamp_ns: int, newest_ns: int | None) -> bool:
    """Whether no companion of a record is waited for any more."""
    late = newest_ns is not None and newest_ns - stamp_ns >= beside.port.patience_ns
    return late or any(item.stamp_ns > stamp_ns - beside.port.ahead_ns for item in beside.waiting)


def _before(beside: _Beside, stamp_ns: int) -> list[Item]:
    """The companions that are handed over before a record."""
    found = []
    while beside.waiting and beside.waiting[0].stamp_ns < stamp_ns + beside.port.ahead_ns:
        found.append(beside.waiting.popleft())
    return found


PERIODS = 3  # between frames: a camera that gives none for so long has failed
LONGEST_NS = 2_000_000_000  # time between frames that is taken for a rate, not for a pause


class Waiting(Protocol):
    """A queue between a node's callbacks and its worker. Not thread-safe."""

    def put(self, key: str, stamp_ns: int, item: Any) -> int:
        """Add an item of a topic; returns how many were dropped for it."""

    def take(self) -> list[Any]:
        """What is to be done next, in order; empty if there is nothing."""


class InOrder:
    """First in, first out; beyond the limit per topic the oldest of that topic is dropped.

    Args:
        limit_of: how many items of a topic wait at most, by its key; None: not limited.
        in_runs: topics, by their keys, of which those that follow one another are taken together.
    """

    def __init__(
        self, limit_of: Callable[[str], int | None] = lambda key: None, in_runs: Collection[str] = ()
    ):
        self._limit_of, self._in_runs = limit_of, frozenset(in_runs)
        self._items: OrderedDict[int, tuple[str, Any]] = OrderedDict()  # by number, in order of arrival
        self._numbers: defaultdict[str, deque[int]] = defaultdict(deque)  # of the items of each topic
        self._newest = 0

    def put(self, key: str, stamp_ns: int, item: Any) -> int:
        """See `Waiting`."""
        own, limit, dropped = self._numbers[key], self._limit_of(key), 0
        if limit is not None and len(own) >= limit:
            del self._items[own.popleft()]
            dropped = 1
        self._newest += 1
        own.append(self._newest)
        self._items[self._newest] = key, item
        return dropped

    def take(self) -> list[Any]:
        """See `Waiting`."""
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


class InstantsAndOthers:
    """Images as instants, everything else in order and first.

    Args:
        instants: takes the topics `keys`. others: takes the rest.
        full: whether no other instant shall begin yet.
    """

    def __init__(
        self,
        instants: Waiting,
        keys: Collection[str],
        others: Waiting,
        full: Callable[[], bool] = lambda: False,
    ):
        self._instants, self._keys, self._others, self._full = instants, frozenset(keys), others, full

    def put(self, key: str, stamp_ns: int, item: Any) -> int:
        """See `Waiting`."""
        return (self._instants if key in self._keys else self._others).put(key, stamp_ns, item)

    def take(self) -> list[Any]:
        """See `Waiting`."""
        return self._others.take() or ([] if self._full() else self._instants.take())


class NewestInstant:
    """For a detector that cannot keep up: the views of one instant together, the newest there is.

    If every camera dropped frames on its own, the frames left would belong to different instants,
    and no person would be seen by two views of one instant.

    Args:
        cameras: names.
        depth: frames that are kept per camera.
        patience_ns: a camera whose newest frame is this much older than the newest of all is not
            waited for; of slow cameras, `PERIODS` times between their frames.
    """

    def __init__(self, cameras: Sequence[str], depth: int = 4, patience_ns: int = 500_000_000):
        self._frames: dict[str, deque[tuple[int, Any]]] = {name: deque() for name in cameras}
        self._seen: dict[str, int] = dict.fromkeys(cameras, -1)
        self._periods: dict[str, int] = dict.fromkeys(cameras, 0)
        self._depth = depth
        self._patience_ns = patience_ns
        self._dropped = 0

    def put(self, key: str, stamp_ns: int, item: Any) -> int:
        """See `Waiting`."""
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
        """The frames nearest to the newest stamp that all living cameras have reached."""
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
) -> Waiting:
    """Live: images wait as instants; a few of everything else, more samples of IMUs, or all where every
    message counts.

    Args:
        present: (topic, owner) of what comes. full: whether no other instant shall begin yet.
    """
    if flow.queue_limit is None:
        return InOrder()
    kinds = {
        topic: {wiring.specs[reader.stage].queue for reader in readers}
        for topic, readers in wiring.readers.items()
    }
    limits = {
        topic: PATIENT if kind == {"all"} else BUSY if kind == {"late"} else flow.queue_limit
        for topic, kind in kinds.items()
    }
    frequent = [f"{topic} {owner}" for topic, owner in present if TOPICS[topic].scope == "imu"]
    others = InOrder(lambda key: limits[key.split(" ")[0]], frequent)
    beside = {port.topic for port in wiring.inputs if port.patience_ns}
    instants = [
        f"{topic} {owner}" for topic, owner in present if "instant" in kinds[topic] and topic not in beside
    ]
    return InstantsAndOthers(NewestInstant(instants), instants, others, full) if instants else others
