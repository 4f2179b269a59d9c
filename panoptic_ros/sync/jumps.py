"""Clocks that jump where no clock model says so: cameras are compared with each other."""
from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from panoptic_ros.domain import ViewDetections
from panoptic_ros.stage import Notice

SECOND = 1_000_000_000
SMALL_NS = SECOND // 10  # stamps that go back by less are frames out of order
SURE = 3  # frames after a jump that make it certain
HELD = 64
AHEAD_NS = SECOND
ALONE = 30  # frames of one camera while no other gives any: then there is nothing to compare with


@dataclass
class GuardedCamera:
    newest: int | None = None
    others: int = -1  # the newest stamp of the others when this camera's newest frame came
    period: int = 0
    back: deque[ViewDetections] = field(default_factory=lambda: deque(maxlen=HELD))
    early: list[ViewDetections] = field(default_factory=list)  # after a step of seconds
    waits: int = 0  # arrivals since the first of these
    ahead: bool = False
    told: bool = False
    goes_on: bool = False  # it gave a good frame since others went back


class JumpGuard:
    """Keeps frames with impossible stamps from being grouped.

    Back: frames whose stamps go back are held. If the stamps of all cameras go back, a clock that they
    share was set back. Master time runs on, so that sets never go back. Ahead (live only): a camera whose
    stamps step ahead by seconds while the others go on as before is left out until they have caught up.
    After a pause its stamps would agree with those of the others.

    Args:
        live: whether frames of all cameras arrive about when they were taken.
    """

    def __init__(self, cameras: Sequence[str], live: bool):
        self._cameras = {name: GuardedCamera() for name in cameras}
        self._live = live
        self._shift = 0
        self._anybody_early = False
        self._refused = 0  # frames since the last good one of any camera

    def take(self, view: ViewDetections, arrived: bool = True) -> tuple[list[ViewDetections], list[Notice]]:
        """The frames that may be grouped, on a time line that never goes back.

        Args:
            arrived: False for a frame that was held and comes together with the one before, so that it
                does not show what other cameras do meanwhile.
        """
        if self._shift:
            view = replace(view, stamp_ns=view.stamp_ns + self._shift)
        camera = self._cameras[view.camera]
        if camera.newest is not None and view.stamp_ns < camera.newest - SMALL_NS:
            return self._hold(camera, view)
        camera.back.clear()
        if self._live and self._steps_ahead(camera, view):
            return self._wait(camera, view, arrived)
        self._accept(camera, view.stamp_ns)
        return self._compare(camera, view) if self._anybody_early else ([view], [])

    def _accept(self, camera: GuardedCamera, stamp_ns: int) -> None:
        if camera.newest is not None and stamp_ns > camera.newest:
            camera.period = stamp_ns - camera.newest
        camera.newest = stamp_ns
        camera.others = self._newest_but(camera) if self._live else -1
        camera.ahead = camera.told = False
        camera.goes_on = True
        self._refused = 0

    def _newest_but(self, own: GuardedCamera) -> int:
        return max((c.newest or -1 for c in self._cameras.values() if c is not own), default=-1)

    # ------------------------------------------------------------------ ahead

    def _steps_ahead(self, camera: GuardedCamera, view: ViewDetections) -> bool:
        """Whether its stamps have advanced by seconds more than those of the others since its last frame."""
        if camera.newest is None or camera.others < 0:
            return False
        others = self._newest_but(camera)
        if camera.ahead:
            return view.stamp_ns - others > AHEAD_NS and self._refused < ALONE
        step = view.stamp_ns - camera.newest
        return step > AHEAD_NS and step - (others - camera.others) > AHEAD_NS

    def _wait(
        self, camera: GuardedCamera, view: ViewDetections, arrived: bool
    ) -> tuple[list[ViewDetections], list[Notice]]:
        """Hold a frame that is ahead: its clock jumped, or all had a pause and others are ahead as well."""
        if camera.ahead:
            self._refused += arrived
            return [], self._tell(camera, view, "ahead of the other cameras")
        camera.early.append(view)
        camera.waits += arrived
        self._anybody_early = True
        paused = [
            c for c in self._cameras.values()
            if c.early and abs(c.early[-1].stamp_ns - view.stamp_ns) < AHEAD_NS
        ]  # fmt: skip
        if len(paused) < 2 and camera.waits <= SURE:
            return [], []
        views = sorted((v for c in paused for v in c.early), key=lambda v: v.stamp_ns)
        for each in paused:
            each.early, each.waits = [], 0
        for released in views:
            self._accept(self._cameras[released.camera], released.stamp_ns)
        return views, []

    def _compare(
        self, going_on: GuardedCamera, view: ViewDetections
    ) -> tuple[list[ViewDetections], list[Notice]]:
        """Another camera goes on as before: clocks that are ahead of its frame have jumped. Where it is there
        as well, frames in between were lost.
        """
        views, notices = [view], []
        for camera in (c for c in self._cameras.values() if c is not going_on and c.early):
            camera.ahead = camera.early[0].stamp_ns - view.stamp_ns > AHEAD_NS
            for early in camera.early:
                if camera.ahead:
                    notices += self._tell(camera, early, "ahead of the other cameras")
                else:
                    self._accept(camera, early.stamp_ns)
                    views.append(early)
            camera.early, camera.waits = [], 0
        self._anybody_early = False
        return sorted(views, key=lambda v: v.stamp_ns), notices

    # ------------------------------------------------------------------ back

    def _hold(self, camera: GuardedCamera, view: ViewDetections) -> tuple[list[ViewDetections], list[Notice]]:
        if camera.back and view.stamp_ns <= camera.back[-1].stamp_ns:
            camera.back.clear()
        if not any(c.back for c in self._cameras.values()):
            for each in self._cameras.values():
                each.goes_on = False
        camera.back.append(view)
        living = self._living()
        if len(camera.back) >= ALONE and not any(c.goes_on for c in self._cameras.values()):
            living = [c for c in living if c.back]  # the others have ended
        if not all(len(c.back) >= SURE for c in living):
            return [], self._tell(camera, view, "earlier than its frames before")
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
            f"the clock of all cameras was set back by {jump / SECOND:.4g} s; the sets' times run on, "
            f"{self._shift / SECOND:.4g} s ahead of it until sync starts anew"
        )
        return views, [Notice("sync.clock_set_back", "warning", text, {"step_s": -jump / SECOND})]

    def _living(self) -> list[GuardedCamera]:
        """Cameras that have given a frame within the last two seconds of the newest."""
        newest = max((c.newest or -1 for c in self._cameras.values()), default=-1)
        return [
            c for c in self._cameras.values()
            if c.back or (c.newest is not None and newest - c.newest < 2 * SECOND)
        ]  # fmt: skip

    def _tell(self, camera: GuardedCamera, view: ViewDetections, how: str) -> list[Notice]:
        """Warn once a jump; its other frames are counted."""
        values = {"camera": view.camera, "stamp_ns": view.stamp_ns}
        text = f"frame {view.frame_number} of camera {view.camera} at {view.stamp_ns} ns waits: it is {how}"
        if camera.told:
            return [Notice("sync.out_of_time", "info", text, values)]
        camera.told = True
        text = f"the clock of camera {view.camera} jumped: its frames are {how}, and are left out"
        return [Notice("sync.clock_jump", "warning", text, values)]
