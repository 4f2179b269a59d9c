"""Queue the frames of one camera, and choose the frame for an instant."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from panoptic_ros.domain import ViewDetections
from panoptic_ros.sync.instants import PeriodEstimate

EARLY = 0.45  # periods; a frame closer before an instant is taken without waiting for the next frame
SLOWER = 1.05  # minimum ratio of a slower camera's period to the time between instants


@dataclass(frozen=True)
class QueuedFrame:
    """Queued frame.

    Args:
        view: the 2D poses.
        period: (ns) period of its camera when it was queued, 0 = unknown.
        stamp: (ns) exposure of its middle row.
    """

    view: ViewDetections
    period: float
    stamp: int


@dataclass(frozen=True)
class FrameChoice:
    """Frame that a camera contributes to an instant.

    Args:
        decided: False while a better frame may still arrive.
        frame: chosen frame; None if the camera has none.
        surplus: older frames that no instant has used.
    """

    decided: bool
    frame: QueuedFrame | None = None
    surplus: tuple[ViewDetections, ...] = ()


class CameraQueue:
    """Queue of the frames of one camera, in timestamp order.

    The choice depends on timestamps alone, never on arrival times.

    Args:
        keeps_last: whether `last_given` is kept.
        middle_ns: exposure of the middle row minus the timestamp.
    """

    def __init__(self, keeps_last: bool = True, middle_ns: int = 0) -> None:
        self._keeps_last = keeps_last
        self.middle_ns = middle_ns
        self.frames: deque[QueuedFrame] = deque()
        self.pace = PeriodEstimate()
        self.ended = False
        self.silent = False
        self.last_given: QueuedFrame | None = None  # newest frame taken or dropped

    @property
    def gives_no_more(self) -> bool:
        """Return whether sets no longer wait for the camera: it has ended or is silent."""
        return self.ended or self.silent

    def add(self, view: ViewDetections) -> bool:
        """Append a frame; return False if it is not later than the previous one."""
        if self.pace.newest is not None and view.stamp_ns <= self.pace.newest:
            return False
        stamp = view.stamp_ns + self.middle_ns
        self.frames.append(QueuedFrame(view, self.pace.add(view.stamp_ns), stamp))
        return True

    def choose(self, instant: int, reach: float, spacing: float, over: bool) -> FrameChoice:
        """Return the frame nearest to an instant; the queue is unchanged until `take`.

        Args:
            reach: (ns) maximum distance of the frame from the instant.
            spacing: (ns) time between instants. A frame of a slower camera beyond half of it is left to the
                next instant.
            over: True if sets wait for no more frames.
        """
        surplus: list[ViewDetections] = []
        over = over or self.gives_no_more
        frames = list(self.frames)
        while frames and frames[0].stamp < instant - reach:
            surplus.append(frames.pop(0).view)
        if not frames:
            return FrameChoice(over, None, tuple(surplus))
        best = frames[0]
        while best.stamp < instant:
            if len(frames) == 1:
                early = EARLY * best.period if best.period else 0.0
                if not over and instant - best.stamp > early:
                    return FrameChoice(False)
                break
            following = frames[1]
            enough = best.period and instant - best.stamp <= EARLY * best.period
            if enough or abs(following.stamp - instant) >= instant - best.stamp:
                break
            surplus.append(frames.pop(0).view)
            best = following
        slower = best.period > SLOWER * spacing
        if best.stamp > instant + (min(reach, 0.5 * spacing) if slower else reach):
            return FrameChoice(True, None, tuple(surplus))
        return FrameChoice(True, best, tuple(surplus))

    def take(self, choice: FrameChoice) -> None:
        """Remove the chosen frame and all older ones."""
        count = len(choice.surplus) + (choice.frame is not None)
        for _ in range(count):
            last = self.frames.popleft()
            self.last_given = last if self._keeps_last else None
