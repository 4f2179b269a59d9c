"""Handle camera clocks that are set back: the time line of the sets continues to increase."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from panoptic_ros.domain import ViewDetections
from panoptic_ros.stage import Notice

SECOND = 1_000_000_000
SMALL_NS = SECOND // 10  # ns; smaller steps back are frames out of order
SURE = 3  # number of frames after a step back that confirm it
# ns, minimum span of these SURE frames before a single camera is reported: other cameras may follow it
SURE_NS = 7 * SECOND // 10
HELD = 64  # maximum number of frames that wait after a step back
# frames of one camera without a frame of another one, after which the other cameras are considered ended
ALONE = 30


@dataclass
class GuardedCamera:
    """State of one camera.

    Args:
        newest: (ns) newest timestamp.
        period: (ns) time between the two newest timestamps.
        back: frames after a step back.
        noticed: True once the step has been reported.
        goes_on: True if the camera has given a good frame since the first camera stepped back.
    """

    newest: int | None = None
    period: int = 0
    back: deque[ViewDetections] = field(default_factory=lambda: deque(maxlen=HELD))
    noticed: bool = False
    goes_on: bool = False


class SetBackGuard:
    """Guard that holds frames whose timestamps go back.

    If the timestamps of all cameras go back, their common clock was set back. The frames are then shifted
    forward by the same time, so that set timestamps never go back. If only one camera goes back, its frames
    are left out.
    """

    def __init__(self, cameras: Sequence[str]):
        self._cameras = {name: GuardedCamera() for name in cameras}
        self._shift = 0

    def take(self, view: ViewDetections) -> tuple[list[ViewDetections], list[Notice]]:
        """Add a frame; return the frames that may be grouped, on a time line that never goes back."""
        if self._shift:
            view = replace(view, stamp_ns=view.stamp_ns + self._shift)
        camera = self._cameras[view.camera]
        if camera.newest is not None and view.stamp_ns < camera.newest - SMALL_NS:
            return self._hold(camera, view)
        camera.back.clear()
        self._accept(camera, view.stamp_ns)
        return [view], []

    def _accept(self, camera: GuardedCamera, stamp_ns: int) -> None:
        if camera.newest is not None and stamp_ns > camera.newest:
            camera.period = stamp_ns - camera.newest
        camera.newest = stamp_ns
        camera.noticed = False
        camera.goes_on = True

    def _hold(self, camera: GuardedCamera, view: ViewDetections) -> tuple[list[ViewDetections], list[Notice]]:
        if camera.back and view.stamp_ns <= camera.back[-1].stamp_ns:
            camera.back.clear()
        if not any(c.back for c in self._cameras.values()):
            for each in self._cameras.values():
                each.goes_on = False
        camera.back.append(view)
        living = self._living()
        if len(camera.back) >= ALONE and not any(c.goes_on for c in self._cameras.values()):
            living = [c for c in living if c.back]  # the other cameras have ended
        if not all(len(c.back) >= SURE for c in living):
            return [], self._tell(camera, view)
        jumps = sorted((c.newest or 0) + c.period - c.back[0].stamp_ns for c in living)
        jump = jumps[len(jumps) // 2]
        self._shift += jump
        views = [replace(v, stamp_ns=v.stamp_ns + jump) for c in living for v in c.back]
        for each in living:
            each.back.clear()
        views.sort(key=lambda v: v.stamp_ns)
        for released in views:
            own = self._cameras[released.camera]
            self._accept(own, max(released.stamp_ns, own.newest or 0))
        text = (
            f"the clock of all cameras was set back by {jump / SECOND:.4g} s; the times of sets "
            f"continue, {self._shift / SECOND:.4g} s ahead of it until sync restarts"
        )
        return views, [Notice("sync.clock_set_back", "warning", text, {"step_s": -jump / SECOND})]

    def _living(self) -> list[GuardedCamera]:
        """Return the cameras with a frame within two seconds of the newest frame."""
        newest = max((c.newest or -1 for c in self._cameras.values()), default=-1)
        return [
            c
            for c in self._cameras.values()
            if c.back or (c.newest is not None and newest - c.newest < 2 * SECOND)
        ]

    def _tell(self, camera: GuardedCamera, view: ViewDetections) -> list[Notice]:
        """Return one warning per jump; its other frames are reported as info."""
        values = {"camera": view.camera, "device": view.camera, "stamp_ns": view.stamp_ns}
        if camera.noticed:
            text = f"frame {view.frame_number} of camera {view.camera} waits: it is earlier than those before"
            return [Notice("sync.out_of_time", "info", text, values)]
        if len(camera.back) < SURE or view.stamp_ns - camera.back[0].stamp_ns < SURE_NS:
            return []  # the other cameras may follow
        camera.noticed = True
        back_s = ((camera.newest or 0) - view.stamp_ns) / SECOND
        text = (
            f"the clock of camera {view.camera} was set back by {back_s:.4g} s: its images are left out "
            "until their stamps are newer again; let the clock be slewed, not set"
        )
        return [Notice("sync.clock_jump", "warning", text, values)]
