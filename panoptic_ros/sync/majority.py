"""Find the clock offset that most cameras share, from their timestamps and the arrival times of frames.

The clock offset of a frame is its timestamp minus its arrival time. Cameras on one clock have the same
offset, except for latency. The newest offset of each camera is its vote. The accepted offset is that of the
largest group of votes. Therefore no single camera can move it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

SECOND = 1_000_000_000
# ns, minimum tolerance of a clock offset; latencies of cameras differ by less, even with a loaded detector
LEAST_REACH_NS = SECOND
# ns, maximum addition to the tolerance for slow cameras. With arrival times the tolerance must stay below
# 2^32 ns = 4.3 s, so that a timestamp that wraps is detected.
MOST_PERIOD_NS = 2 * SECOND
GAPS = 5  # number of frame gaps whose median is the period of a camera
FRESH_NS = 2 * SECOND  # ns, maximum age of a valid vote, for cameras above 2 Hz
FRESH_PERIODS = 4  # frame periods, maximum age of a valid vote, for slower cameras


@dataclass
class Vote:
    """Vote of one camera: its newest frame.

    Args:
        offset: (ns) timestamp minus arrival time.
        at: (ns) arrival time; None before the first frame.
        gaps: (ns) intervals between the newest arrivals.
    """

    offset: int = 0
    at: int | None = None
    gaps: deque[int] = field(default_factory=lambda: deque(maxlen=GAPS))

    @property
    def period(self) -> int:
        """Return the median interval between arrivals, ns; 0 before the second frame."""
        return sorted(self.gaps)[len(self.gaps) // 2] if self.gaps else 0


class ClockGroup(NamedTuple):
    """Cameras whose clock offsets agree; `offset` is their median, ns."""

    offset: int
    names: tuple[str, ...]


class Majority:
    """Accepted clock offset, and the votes of all cameras.

    Args:
        cameras: names, in rig order.
        periods: tolerance of the offset of a slow camera, in periods.
    """

    def __init__(self, cameras: Iterable[str], periods: int = 1):
        self.votes = {name: Vote() for name in cameras}
        self.offset: int | None = None  # ns, accepted clock offset; None before the time line has begun
        self.reach = LEAST_REACH_NS  # ns, maximum distance from the accepted offset at which a camera agrees
        self._periods = periods
        self._count = 0  # number of votes since the last update of the offset

    def vote(self, camera: str, stamp_ns: int, at: int) -> int:
        """Add a frame; return its clock offset, ns."""
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
        """Return whether a clock offset agrees with the accepted one."""
        return self.offset is not None and abs(offset - self.offset) <= self.reach

    @property
    def complete(self) -> bool:
        """Return whether every camera has given a frame."""
        return all(vote.at is not None for vote in self.votes.values())

    def groups(self, at: int) -> list[ClockGroup]:
        """Return the groups of cameras with valid votes, sorted by size (descending), then by rig order."""
        fresh = self._fresh(at)
        found: list[ClockGroup] = []
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
            found.append(ClockGroup(_median([fresh[name] for name in names]), names))
            left = {name: offset for name, offset in left.items() if name not in best}
        order = list(self.votes)
        return sorted(found, key=lambda group: (-len(group.names), order.index(group.names[0])))

    def _fresh(self, at: int) -> dict[str, int]:
        """Return the votes that are not too old, by camera."""
        return {
            name: vote.offset
            for name, vote in self.votes.items()
            if vote.at is not None and at - vote.at <= max(FRESH_NS, FRESH_PERIODS * vote.period)
        }

    def _update(self, at: int) -> None:
        """Update the accepted offset from the agreeing cameras, and the tolerance from the slowest one."""
        fresh = self._fresh(at)
        agreeing = [name for name, offset in fresh.items() if self.agrees(offset)]
        if agreeing:
            self.offset = _median([fresh[name] for name in agreeing])
        slowest = max((self.votes[name].period for name in agreeing or fresh), default=0)
        self.reach = LEAST_REACH_NS + self._periods * min(slowest, MOST_PERIOD_NS)


def _median(offsets: Sequence[int]) -> int:
    """Return the lower median."""
    return sorted(offsets)[(len(offsets) - 1) // 2]
