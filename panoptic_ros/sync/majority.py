"""The time line that most cameras share, from their stamps and the times at which frames arrive.

The clock offset of a frame is its stamp minus its arrival. Cameras on one clock have the same offset, but for
latency. The newest offset of each camera is its vote. The time line has the offset of the largest group of
votes. So no single camera can move it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

SECOND = 1_000_000_000
LEAST_REACH_NS = SECOND  # between cameras, latencies of a loaded detector differ by less
MOST_PERIOD_NS = 2 * SECOND  # allowance for slow cameras: a wrap of 2^32 ns is 4.3 s and must stay outside
GAPS = 5  # frames whose median gap is the period of a camera
FRESH_NS = 2 * SECOND  # age of a vote that still counts, for cameras above 2 Hz
FRESH_PERIODS = 4  # the same in periods of a slower camera


@dataclass
class Vote:
    """The newest frame of one camera.

    Args:
        offset: its stamp minus its arrival, ns. at: its arrival, ns; None: there was no frame.
        gaps: ns between the newest arrivals.
    """

    offset: int = 0
    at: int | None = None
    gaps: deque[int] = field(default_factory=lambda: deque(maxlen=GAPS))

    @property
    def period(self) -> int:
        """The median time between arrivals, ns; 0 before the second frame."""
        return sorted(self.gaps)[len(self.gaps) // 2] if self.gaps else 0


class Group(NamedTuple):
    """Cameras whose clock offsets agree; `offset` is their median, ns."""

    offset: int
    names: tuple[str, ...]


class Majority:
    """Holds the clock offset of the time line.

    Args:
        cameras: names in the order of the rig.
        periods: how many periods of a slow camera its offset may vary by.
    """

    def __init__(self, cameras: Iterable[str], periods: int = 1):
        self.votes = {name: Vote() for name in cameras}
        self.offset: int | None = None  # of the time line
        self.reach = LEAST_REACH_NS  # from it, in which a camera agrees
        self._periods = periods
        self._count = 0  # of votes since the offset was updated

    def vote(self, camera: str, stamp_ns: int, at: int) -> int:
        """Take a frame; return its clock offset, ns."""
        vote = self.votes[camera]
        if vote.at is not None:
            vote.gaps.append(at - vote.at)
        vote.offset, vote.at = stamp_ns - at, at
        self._count += 1
        if self._count >= len(self.votes):
            self._count = 0
            self._update(at)
        return vote.offset

    def agrees(self, offset: int) -> bool:
        """Return whether a clock offset is that of the time line."""
        return self.offset is not None and abs(offset - self.offset) <= self.reach

    @property
    def complete(self) -> bool:
        """Return whether every camera has given a frame."""
        return all(vote.at is not None for vote in self.votes.values())

    def groups(self, at: int) -> list[Group]:
        """Return the groups of cameras with fresh votes, the largest first, then in the order of the rig."""
        fresh = self._fresh(at)
        found: list[Group] = []
        left = dict(fresh)
        while left:
            ordered = sorted(left.items(), key=lambda item: item[1])
            best = max(
                (
                    [name for name, other in ordered[k:] if other - first <= self.reach]
                    for k, (_, first) in enumerate(ordered)
                ),
                key=len,
            )
            names = tuple(name for name in fresh if name in best)
            found.append(Group(_median([fresh[name] for name in names]), names))
            left = {name: offset for name, offset in left.items() if name not in best}
        order = list(self.votes)
        return sorted(found, key=lambda group: (-len(group.names), order.index(group.names[0])))

    def _fresh(self, at: int) -> dict[str, int]:
        """The votes that are not too old, by camera."""
        return {
            name: vote.offset
            for name, vote in self.votes.items()
            if vote.at is not None and at - vote.at <= max(FRESH_NS, FRESH_PERIODS * vote.period)
        }

    def _update(self, at: int) -> None:
        """Follow the cameras that agree, and allow for the slowest of them."""
        fresh = self._fresh(at)
        agreeing = [name for name, offset in fresh.items() if self.agrees(offset)]
        if agreeing:
            self.offset = _median([fresh[name] for name in agreeing])
        slowest = max((self.votes[name].period for name in agreeing or fresh), default=0)
        self.reach = LEAST_REACH_NS + self._periods * min(slowest, MOST_PERIOD_NS)


def _median(offsets: Sequence[int]) -> int:
    """The lower median."""
    return sorted(offsets)[(len(offsets) - 1) // 2]
