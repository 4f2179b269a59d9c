"""Live: leave out and name the cameras whose clock disagrees with the majority.

The accepted clock offset is that of the majority of cameras (see `majority`). Each camera also has a pending
line with its frames that deviate from it. A pending line is judged after three frames over 0.5 s. If most
cameras are on it, the accepted offset moves there. Otherwise the camera is left out until its frames agree
again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Generic, Protocol, TypeVar

from panoptic_ros.stage import Notice
from panoptic_ros.sync.majority import ClockGroup, Majority

SECOND = 1_000_000_000
SURE = 3  # minimum number of frames that decide on a pending line
# ns, minimum span of these frames. A burst after a stall is shorter. START_NS (1 s) is the upper limit.
SURE_NS = SECOND // 2
# ns after the first frame at which the time line begins without cameras that have no frames yet
START_NS = SECOND
ALONE_NS = 10 * SECOND  # ns after which a notice names a camera that no other camera confirms
AGAIN_NS = 5 * SECOND  # ns between notices on one camera; /diagnostics drops a warning after 10 s
OFFSETS = 5  # frames whose median clock offset is reported; single ones scatter with the latency
HELD = 64  # maximum number of frames kept on a pending line
NEAR_NS = 2 * SECOND  # ns, maximum step between consecutive frames of one line, for cameras above 2 Hz
NEAR_STEPS = 4  # frame steps, maximum step between consecutive frames of one line, for slower cameras
MOST_NEAR_NS = 40 * SECOND  # ns, upper bound of NEAR_STEPS frame steps: four steps at 0.1 Hz
YEAR_NS = 365 * 86_400 * SECOND
# frame periods, tolerance of a clock offset if arrival times are missing: "now" is then the median of the
# cameras' newest timestamps, which is right only to 1 or 2 periods
PERIODS_BY_STAMPS = 3


class StampedFrame(Protocol):
    """Frame of a camera: an image, or the 2D poses detected in it."""

    @property
    def camera(self) -> str:
        """Return the name of the camera."""

    @property
    def stamp_ns(self) -> int:
        """Return the timestamp on the clock of the camera, ns."""

    @property
    def frame_number(self) -> int:
        """Return the frame number given by the camera."""


Frame = TypeVar("Frame", bound=StampedFrame)


@dataclass
class PendingLine(Generic[Frame]):
    """Frames of one camera that deviate from the accepted clock offset.

    Args:
        frames: (list) newest of these frames.
        count: (number) all frames of the line, including those no longer kept.
        since: (ns) arrival of the first frame of the line; None if the line is empty.
        offsets: (ns) clock offsets of the newest frames relative to the accepted offset.
        out: True if the camera is left out.
        text: notice text for the camera.
        noticed_at: (ns) arrival time at the last notice.
    """

    frames: list[Frame] = field(default_factory=list)
    count: int = 0
    since: int | None = None
    offsets: deque[int] = field(default_factory=lambda: deque(maxlen=OFFSETS))
    out: bool = False
    text: str = ""
    noticed_at: int = 0

    def add(self, view: Frame, at: int) -> list[Frame]:
        """Append a frame; return the frames that are no longer kept."""
        self.since = at if self.since is None else self.since
        self.count += 1
        self.frames.append(view)
        return self.keep(SURE if self.out else HELD)

    def keep(self, most: int) -> list[Frame]:
        """Keep the newest `most` frames; return the older frames, which are removed."""
        lost, self.frames = self.frames[:-most], self.frames[-most:]
        return lost

    def is_sure(self, at: int) -> bool:
        """Return whether there are enough frames to decide."""
        return self.count >= SURE and self.since is not None and at - self.since >= SURE_NS

    def clear(self, following: Frame | None = None) -> tuple[list[Frame], list[Frame]]:
        """Remove all pending frames; return those that form a gapless sequence, and the others.

        Args:
            following: frame after the sequence, which has the accepted offset. None = the sequence ends with
                the last pending frame.
        """
        frames, self.frames, self.count, self.since = self.frames, [], 0, None
        self.offsets.clear()
        steps = [later.stamp_ns - view.stamp_ns for view, later in pairwise(frames)]
        least = min((step for step in steps if step > 0), default=0)
        near = max(NEAR_NS, min(NEAR_STEPS * least, MOST_NEAR_NS))
        kept: list[Frame] = []
        strays: list[Frame] = []
        for view in reversed(frames):
            if following is None or 0 < following.stamp_ns - view.stamp_ns <= near:
                kept.append(view)
                following = view
            else:
                strays.append(view)
        return kept[::-1], strays[::-1]


class Agreement(Generic[Frame]):
    """Filter that passes the frames whose clock offset equals the offset of the majority.

    Args:
        cameras: names, in rig order.
        start_ns: (ns) time after the first frame for which the time line waits for cameras without frames.
    """

    def __init__(self, cameras: Sequence[str], start_ns: int = START_NS):
        self._by_arrival, self._by_stamps = Majority(cameras), Majority(cameras, PERIODS_BY_STAMPS)
        # newest timestamp of each camera, used if arrival times are missing
        self._stamps: dict[str, int] = {}
        self._lines: dict[str, PendingLine[Frame]] = {name: PendingLine() for name in cameras}
        self._start_ns = min(start_ns, START_NS)
        self._began: int | None = None  # arrival of the first frame

    @property
    def offset(self) -> int | None:
        """Return the accepted clock offset by arrival times (ns); None before the time line has begun."""
        return self._by_arrival.offset

    def take(
        self, view: Frame, came_ns: int | None = None, host_ns: int | None = None
    ) -> tuple[list[Frame], list[Notice]]:
        """Add a frame; return the frames that may be grouped in timestamp order, and notices.

        Args:
            came_ns: arrival on a monotonic clock. None: the median of the cameras' newest timestamps is used
                instead.
            host_ns: arrival on the host's clock, which decides if there is no majority.
        """
        if came_ns is None:
            self._stamps[view.camera] = view.stamp_ns
            majority, at = self._by_stamps, sorted(self._stamps.values())[(len(self._stamps) - 1) // 2]
        else:
            majority, at = self._by_arrival, came_ns
        host = None if host_ns is None or came_ns is None else host_ns - came_ns
        offset, line = majority.vote(view.camera, view.stamp_ns, at), self._lines[view.camera]
        if majority.offset is None:
            return self._gather(majority, view, at, host)
        if majority.agrees(offset):
            return self._admit(line, view)
        line.offsets.append(offset - majority.offset)
        notices = [_out_of_time(lost) for lost in line.add(view, at)]
        if line.is_sure(at):
            return self._decide(majority, view.camera, at, host, notices)
        return [], notices

    def end(self, camera: str) -> tuple[list[Frame], list[Notice]]:
        """End a camera; return its frames if the time line has not begun, and notices.

        Once the time line has begun, frames of the camera with a deviating offset are dropped.
        """
        line = self._lines[camera]
        begun = self._by_arrival.offset is not None or self._by_stamps.offset is not None
        frames, line.frames = line.frames, []
        return ([], [_stray(view) for view in frames]) if begun or line.out else (frames, [])

    # ------------------------------------------------------------------ start

    def _gather(
        self, majority: Majority, view: Frame, at: int, host: int | None
    ) -> tuple[list[Frame], list[Notice]]:
        """Begin the time line once all cameras have given frames, or after a waiting time."""
        line = self._lines[view.camera]
        self._began = at if self._began is None else self._began
        notices = [_out_of_time(lost) for lost in line.add(view, at)]
        if line.count < SURE or not (majority.complete or at - self._began >= self._start_ns):
            return [], notices
        groups = majority.groups(at)
        best = _choose([g for g in groups if len(g.names) == len(groups[0].names)], majority, host)
        unsure = host is not None and abs(best.offset - host) > majority.reach
        if len(best.names) == 1 and len(self._lines) > 1 and unsure:
            if at - self._began >= ALONE_NS and not line.out:
                whom = "the host's time, and no other camera confirms them"
                line.out, line.noticed_at = True, at
                line.text = _off_text(view, best.offset - (host or 0), whom)
                notices.append(_off(view, line.text))
            return [], notices
        majority.offset = best.offset
        return self._release(majority, notices)

    # ------------------------------------------------------------------ pending lines

    def _admit(self, line: PendingLine[Frame], view: Frame) -> tuple[list[Frame], list[Notice]]:
        """Pass a frame with the accepted offset, and the pending frames that directly precede it."""
        if not line.count and not line.out:
            return [view], []
        notices: list[Notice] = []
        released, strays = line.clear(view)
        notices += [_out_of_time(stray) if line.out else _stray(stray) for stray in strays]
        if line.out:
            line.out = False
            text = f"stamps of camera {view.camera} agree with those of the other cameras again: it is used"
            notices.append(Notice("sync.clock_agrees", "info", text, _values(view)))
        return [*released, view], notices

    def _decide(
        self, majority: Majority, camera: str, at: int, host: int | None, notices: list[Notice]
    ) -> tuple[list[Frame], list[Notice]]:
        """Move the accepted offset to a pending line, or leave the camera of that line out."""
        view = self._lines[camera].frames[-1]
        assert majority.offset is not None
        groups = majority.groups(at)
        best = groups[0]
        known = sum(vote.at is not None for vote in majority.votes.values())
        fresh = sum(len(group.names) for group in groups)
        tie = 2 * len(best.names) <= fresh or (len(best.names) == 1 and known > 1)
        if tie:
            on_line = [g for g in groups if majority.agrees(g.offset)]
            rivals = [g for g in groups if len(g.names) == len(best.names)]
            others = ClockGroup(majority.offset, on_line[0].names if on_line else ())
            best = _choose([others, *(g for g in rivals if g not in on_line)], majority, host, others)
        if camera in best.names and not majority.agrees(best.offset):
            majority.offset = best.offset
            if tie and len(best.names) < known:
                notices.append(_decided(view, best, groups))
            return self._release(majority, notices)
        rulers = [name for group in groups if majority.agrees(group.offset) for name in group.names]
        self._leave_out(view, at, rulers if tie else [], notices)
        return [], notices

    def _leave_out(self, view: Frame, at: int, rulers: Sequence[str], notices: list[Notice]) -> None:
        """Leave a camera out. Give a notice that names it, and repeat the notice while the camera is out.

        Args:
            rulers: cameras confirmed by the host's time, if there is no majority.
        """
        line = self._lines[view.camera]
        if not line.out:
            whom = "those of the other cameras"
            if rulers:
                whom = f"those of camera {' and '.join(rulers)}, for which the host's time decides"
            offset = sorted(line.offsets)[len(line.offsets) // 2]
            line.text, line.noticed_at = _off_text(view, offset, whom), at
            notices.append(_off(view, line.text))
        elif at - line.noticed_at >= AGAIN_NS:
            line.noticed_at = at
            notices.append(_off(view, line.text))
        line.out, line.count, line.since = True, 0, None
        notices += [_out_of_time(lost) for lost in line.keep(SURE)]

    def _release(self, majority: Majority, notices: list[Notice]) -> tuple[list[Frame], list[Notice]]:
        """Pass all pending frames of cameras that now have the accepted offset."""
        views: list[Frame] = []
        for name, line in self._lines.items():
            if (line.count or line.out) and majority.agrees(majority.votes[name].offset):
                released, strays = line.clear()
                views += released
                notices += [_stray(stray) for stray in strays]
                line.out = False
        return sorted(views, key=lambda view: view.stamp_ns), notices


def _choose(
    groups: Iterable[ClockGroup], majority: Majority, host: int | None, incumbent: ClockGroup | None = None
) -> ClockGroup:
    """Return the group that agrees with the host's time, else the incumbent group, else the first group."""
    groups = list(groups)
    if host is not None:
        near = min(groups, key=lambda group: abs(group.offset - host))
        if incumbent is None or abs(near.offset - host) <= majority.reach < abs(incumbent.offset - host):
            return near
    return incumbent or groups[0]


def _values(view: StampedFrame) -> dict[str, object]:
    return {"camera": view.camera, "device": view.camera, "stamp_ns": view.stamp_ns}


def _off(view: StampedFrame, text: str) -> Notice:
    return Notice("sync.clock_off", "warning", text, _values(view))


def _off_text(view: StampedFrame, offset: int, whom: str) -> str:
    """Return the notice text for a camera that is left out, with its clock offset (ns) from the others."""
    why = "set its clock, or the time source of its driver"
    if view.stamp_ns < YEAR_NS < view.stamp_ns - offset:
        why = "they count from another start, e.g. that of the device: " + why
    side = "ahead of" if offset > 0 else "behind"
    return (
        f"stamps of camera {view.camera} are {abs(offset) / SECOND:.1f} s {side} {whom}: its images are left "
        f"out until they agree; {why}"
    )


def _decided(view: StampedFrame, best: ClockGroup, groups: Sequence[ClockGroup]) -> Notice:
    """Return a notice with the cameras of both sides if the host's time decided for a new offset."""
    others = [name for group in groups for name in group.names if name not in best.names]
    text = (
        f"stamps of camera {' and '.join(best.names)} disagree with those of "
        f"{' and '.join(others) or 'the others'}: the host's time decides for the former; set all clocks"
    )
    return Notice("sync.clock_tie", "warning", text, _values(view))


def _stray(view: StampedFrame) -> Notice:
    text = (
        f"frame {view.frame_number} of camera {view.camera} at {view.stamp_ns} ns was dropped: "
        "its stamp is an outlier among those of its camera before and after"
    )
    return Notice("sync.stray_stamp", "warning", text, {"camera": view.camera, "stamp_ns": view.stamp_ns})


def _out_of_time(view: StampedFrame) -> Notice:
    text = (
        f"frame {view.frame_number} of camera {view.camera} at {view.stamp_ns} ns was dropped: "
        "its clock disagrees with that of the other cameras"
    )
    return Notice("sync.out_of_time", "info", text, {"camera": view.camera, "stamp_ns": view.stamp_ns})
