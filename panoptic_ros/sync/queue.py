"""The frames of one camera that wait, and which of them belongs to an instant."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from panoptic_ros.domain import ViewDetections
from panoptic_ros.sync.instants import Pace

EARLY = 0.45  # of a period: a frame so little before an instant needs no comparison with the next one
SLOWER = 1.05  # times the time between instants: the period of a slower camera


@dataclass(frozen=True)
class Waiting:
    """A frame with the period of its camera as it was known then, ns (0: not known)."""

    view: ViewDetections
    period: float

    @property
    def stamp(self) -> int:
        return self.view.stamp_ns


@dataclass(frozen=True)
class Choice:
    """What a camera gives to an instant.

    Args:
        decided: False while a better frame may still come.
        frame: None: the camera has none.
        surplus: older frames that no instant has used.
    """

    decided: bool
    frame: Waiting | None = None
    surplus: tuple[ViewDetections, ...] = ()


class CameraQueue:
    """The waiting frames of one camera, in the order of their stamps.

    What is chosen depends on stamps alone, never on when frames arrived.
    """

    def __init__(self, keeps_last: bool = True) -> None:
        self._keeps_last = keeps_last
        self.frames: deque[Waiting] = deque()
        self.pace = Pace()
        self.ended = False
        self.silent = False
        self.last_given: Waiting | None = None  # of an earlier instant, or too old for this one

    @property
    def gives_no_more(self) -> bool:
        """Whether nobody waits for its next frame."""
        return self.ended or self.silent

    def add(self, view: ViewDetections) -> bool:
        """Append a frame; False if it is not later than the one before."""
        if self.pace.newest is not None and view.stamp_ns <= self.pace.newest:
            return False
        self.frames.append(Waiting(view, self.pace.add(view.stamp_ns)))
        return True

    def choose(self, instant: int, reach: float, spacing: float, over: bool) -> Choice:
        """The frame nearest to an instant; nothing changes until `take`.

        Args:
            reach: the farthest it may be, ns.
            spacing: between instants, ns. A slower camera's frame beyond half of it is left to the next one.
            over: whether no more frames are waited for.
        """
        surplus: list[ViewDetections] = []
        over = over or self.gives_no_more
        frames = list(self.frames)
        while frames and frames[0].stamp < instant - reach:
            surplus.append(frames.pop(0).view)
        if not frames:
            return Choice(over, None, tuple(surplus))
        best = frames[0]
        while best.stamp < instant:
            if len(frames) == 1:
                early = EARLY * best.period if best.period else 0.0
                if not over and instant - best.stamp > early:
                    return Choice(False)
                break
            following = frames[1]
            enough = best.period and instant - best.stamp <= EARLY * best.period
            if enough or abs(following.stamp - instant) >= instant - best.stamp:
                break
            surplus.append(frames.pop(0).view)
            best = following
        slower = best.period > SLOWER * spacing
        if best.stamp > instant + (min(reach, 0.5 * spacing) if slower else reach):
            return Choice(True, None, tuple(surplus))
        return Choice(True, best, tuple(surplus))

    def take(self, choice: Choice) -> None:
        """Remove a choice and what is older."""
        count = len(choice.surplus) + (choice.frame is not None)
        for _ in range(count):
            last = self.frames.popleft()
            self.last_given = last if self._keeps_last else None
