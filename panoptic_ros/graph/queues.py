"""What a node keeps waiting, and what it takes next when it falls behind."""

from __future__ import annotations

from collections import OrderedDict, defaultdict, deque
from collections.abc import Callable, Collection, Sequence
from typing import Any, Protocol

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
