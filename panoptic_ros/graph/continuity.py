"""Live: which stamps go on from those before, on topics whose records come one after another.

A stage refuses what is older than the newest that it has seen. One wild stamp ahead would therefore cost all
that follows, and must not get to it.

Live: times by which images of several cameras are put together, whatever their clocks say.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from panoptic_ros.stage import Notice
from panoptic_ros.sync.agreement import Agreement

SECOND = 1_000_000_000
LEAST_AHEAD_NS = SECOND // 2  # beyond the time that has gone by
FASTER = 1.5  # stamps may go by this much faster than the clock, e.g. while a backlog comes
GONE_NS = SECOND  # without a good record, and of records that agree: then another time line is right
SLOWEST_NS = 5 * SECOND  # between stamps that can be of one time line
SURE = 5  # records in a row that agree with each other make it certain
LEAD_NS = 10 * SECOND  # for which it is known how far stamps are ahead of the clock: one line may go slower
WAITING = 256  # records between their arrival and their use, at most
OLD_NS = 60 * SECOND  # a copy of what came long ago, not a clock that was set back

Verdict = Literal["", "stale", "odd_stamp"]


@dataclass
class Continuity:
    """Judges stamps by the newest that was used. Times are of a clock that goes as the stamps' own, ns.

    What is used late, after a stall or while a node starts, is old: records that then come in time are not
    ahead of their line. They are measured by how far stamps were ahead of the clock when they came.

    Where a recording with few sets a second is played faster than that clock, its steps look like jumps at
    first: it is taken as another time line, of which longer steps are known.
    """

    _newest: int | None = None  # stamp that was used
    _used_ns: int = 0  # when that record came
    _came: deque[tuple[int, int]] = field(default_factory=lambda: deque(maxlen=WAITING))  # (stamp, when)
    _leads: tuple[int | None, int | None] = None, None  # most of stamps over the clock: LEAD_NS before, since
    _lead_since_ns: int = 0
    _other: int = 0  # the newest stamp of what may be another time line
    _agreeing: int = 0
    _longest: int = 0  # step between these
    _since_ns: int = 0  # when the first of them came
    _pace: int = 0  # the longest step of what was found to be another time line

    def judge(self, stamp_ns: int, now_ns: int) -> Verdict:
        """What is wrong with a stamp; "" if nothing is."""
        verdict = self._verdict(stamp_ns, now_ns)
        if not verdict:
            self._came.append((stamp_ns, now_ns))
        return verdict

    def _verdict(self, stamp_ns: int, now_ns: int) -> Verdict:
        if self._newest is None:
            return ""
        step = stamp_ns - self._newest
        if 0 < step <= self._farthest(now_ns - self._used_ns):
            return ""
        if step > 0 and self._is_in_time(stamp_ns, now_ns):
            return ""
        if self._is_other(stamp_ns, now_ns) and now_ns - self._used_ns >= GONE_NS:
            return ""
        return "stale" if -OLD_NS < step <= 0 else "odd_stamp"

    def used(self, stamp_ns: int, now_ns: int) -> None:
        """A record with this stamp was good, and is the newest now."""
        arrivals = reversed(tuple(self._came))
        came_ns = next((when for stamp, when in arrivals if stamp == stamp_ns), now_ns)
        if self._newest is not None and stamp_ns < self._newest:
            self._leads = None, None  # another line
        self._newest, self._used_ns, self._agreeing = stamp_ns, came_ns, 0
        before, since = self._leads
        if came_ns - self._lead_since_ns > LEAD_NS:
            before, since, self._lead_since_ns = since, None, came_ns
        lead = stamp_ns - came_ns
        self._leads = before, lead if since is None else max(since, lead)

    def _is_in_time(self, stamp_ns: int, now_ns: int) -> bool:
        """Whether a stamp is ahead of the clock by no more than others were of late."""
        leads = [lead for lead in self._leads if lead is not None]
        return bool(leads) and stamp_ns <= now_ns + max(leads) + LEAST_AHEAD_NS

    def _is_other(self, stamp_ns: int, now_ns: int) -> bool:
        """Whether enough records one after another, for long enough, are of another time line."""
        step = stamp_ns - self._other
        if self._agreeing and 0 < step <= SLOWEST_NS:
            self._agreeing += 1
            self._longest = max(self._longest, step)
        elif not self._agreeing or stamp_ns != self._other:
            self._agreeing, self._longest, self._since_ns = 1, 0, now_ns
        self._other = stamp_ns
        if self._agreeing < SURE or now_ns - self._since_ns < GONE_NS:
            return False
        self._pace = self._longest
        return True

    def _farthest(self, passed_ns: int) -> float:
        return max(LEAST_AHEAD_NS + FASTER * passed_ns, FASTER * self._pace)


class ImageStamp(NamedTuple):
    """The stamp of an image that has arrived; see `sync.agreement.StampedFrame`."""

    camera: str
    stamp_ns: int
    frame_number: int


class AlignedTimes:
    """Gives images of cameras whose clock disagrees with the majority their time by arrival.

    So a camera with wrong stamps is put together with the images that arrive with its own, and does not keep
    the others from being taken. It is named by its images, before a busy detector has looked at any of them.
    `sync` decides by the same rules whether its stamps are used. May be used by several threads.

    Args:
        cameras: names in the order of the rig.
    """

    def __init__(self, cameras: Sequence[str]):
        self._agreement: Agreement[ImageStamp] = Agreement(cameras)
        self._counts = dict.fromkeys(cameras, 0)
        self._lock = threading.Lock()

    def time_of(self, camera: str, stamp_ns: int, came_ns: int, host_ns: int) -> tuple[int, list[Notice]]:
        """Return the time of an image on the clock of the majority, ns, and notices about its camera.

        Args:
            came_ns, host_ns: its arrival on a monotonic clock and on the clock of the host.
        """
        with self._lock:
            self._counts[camera] += 1
            image = ImageStamp(camera, stamp_ns, self._counts[camera])
            agreeing, notices = self._agreement.take(image, came_ns, host_ns)
            offset = self._agreement.offset
        told = [notice for notice in notices if notice.code.startswith("sync.clock_")]
        if image in agreeing or offset is None:
            return stamp_ns, told
        return came_ns + offset, told
