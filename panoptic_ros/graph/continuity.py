"""Live checks of timestamps.

`Continuity` rejects timestamps that do not continue the earlier ones, on topics with consecutive records. A
stage refuses every record that is older than the newest one it has processed. One timestamp far in the future
would therefore block all later records, so it must not reach the stage.

`AlignedTimes` gives the times by which images of several cameras are grouped, even if a clock is wrong.
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
LEAST_AHEAD_NS = SECOND // 2  # 0.5 s; allowed step of a timestamp beyond the elapsed time
FASTER = 1.5  # factor by which timestamps may advance faster than the clock, e.g. while a backlog arrives
# 1 s; another time line is accepted if for this long no record was good, and the other records have agreed
# for this long
GONE_NS = SECOND
SLOWEST_NS = 5 * SECOND  # 5 s; longest step between timestamps of one time line
SURE = 5  # agreeing records in a row that confirm another time line
# 10 s; window of the largest lead (timestamp minus clock), because a time line may be slower than the clock
LEAD_NS = 10 * SECOND
WAITING = 256  # most records between arrival and use
# 60 s; a timestamp less far back is a repeated old record, not a clock that was set back
OLD_NS = 60 * SECOND

Verdict = Literal["", "stale", "odd_stamp"]


@dataclass
class Continuity:
    """Check of timestamps against the newest used one.

    Times are of a clock with the rate of the timestamps, ns. A record that is used late, after a stall or
    during start-up, has an old timestamp. Records that then arrive on time only seem to be ahead. They are
    therefore compared with the recent lead of timestamps over the clock at arrival.

    If a recording with few sets per second is played faster than the clock, its steps first look like jumps.
    It is then accepted as another time line, which allows longer steps.
    """

    _newest: int | None = None  # newest used timestamp
    _used_ns: int = 0  # arrival time of the record with that timestamp
    # (timestamp, arrival time)
    _came: deque[tuple[int, int]] = field(default_factory=lambda: deque(maxlen=WAITING))
    # largest lead (timestamp minus clock): in the previous window of LEAD_NS, and in the current one
    _leads: tuple[int | None, int | None] = None, None
    _lead_since_ns: int = 0
    _other: int = 0  # newest timestamp of a possible other time line
    _agreeing: int = 0
    _longest: int = 0  # longest step between its timestamps
    _since_ns: int = 0  # arrival time of the first record of it
    _pace: int = 0  # longest step of an accepted other time line

    def judge(self, stamp_ns: int, now_ns: int) -> Verdict:
        """Return the fault of a timestamp; "" if there is none."""
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
        """Take the timestamp of a good record as the newest one."""
        arrivals = reversed(tuple(self._came))
        came_ns = next((when for stamp, when in arrivals if stamp == stamp_ns), now_ns)
        if self._newest is not None and stamp_ns < self._newest:
            self._leads = None, None  # another time line
        self._newest, self._used_ns, self._agreeing = stamp_ns, came_ns, 0
        before, since = self._leads
        if came_ns - self._lead_since_ns > LEAD_NS:
            before, since, self._lead_since_ns = since, None, came_ns
        lead = stamp_ns - came_ns
        self._leads = before, lead if since is None else max(since, lead)

    def _is_in_time(self, stamp_ns: int, now_ns: int) -> bool:
        """Return whether a timestamp's lead over the clock is not above the recent leads."""
        leads = [lead for lead in self._leads if lead is not None]
        return bool(leads) and stamp_ns <= now_ns + max(leads) + LEAST_AHEAD_NS

    def _is_other(self, stamp_ns: int, now_ns: int) -> bool:
        """Return whether enough consecutive records, over a long enough time, are on another time line."""
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
    """Timestamp of an image that has arrived; see `sync.agreement.StampedFrame`."""

    camera: str
    stamp_ns: int
    frame_number: int


class AlignedTimes:
    """Times for grouping images: a camera whose clock disagrees with the majority gets its time of arrival.

    A camera with wrong timestamps is thus grouped with the images that arrive at the same time, and does not
    block the others. It is reported as soon as its images arrive, before a busy detector has processed any of
    them. `sync` uses the same rules to decide whether its timestamps are used. Several threads may use an
    instance.

    Args:
        cameras: Names in the order of the rig.
    """

    def __init__(self, cameras: Sequence[str]):
        self._agreement: Agreement[ImageStamp] = Agreement(cameras)
        self._counts = dict.fromkeys(cameras, 0)
        self._lock = threading.Lock()

    def time_of(self, camera: str, stamp_ns: int, came_ns: int, host_ns: int) -> tuple[int, list[Notice]]:
        """Return the time of an image on the clock of the majority, ns, and notices about its camera.

        Args:
            camera: Name.
            stamp_ns: Timestamp of the image.
            came_ns, host_ns: Time of arrival on a monotonic clock and on the host's clock.
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
