"""Live: how far capture time has come, and which cameras are silent."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from panoptic_ros.stage import Notice

SECOND = 1_000_000_000
SURE = 3  # frames of one camera that make a time certain: a wrong stamp or two close no set
SILENT_PERIODS = 3  # without a frame, after which nobody waits for a camera
PAUSE_NS = 2 * SECOND  # a longer step of capture time is a pause of everybody


@dataclass
class LiveCamera:
    """One camera: its newest stamps, and how much capture time had gone by when its newest frame came."""

    recent: deque[int] = field(default_factory=lambda: deque(maxlen=SURE))
    heard_ns: int | None = None
    silent: bool = False


class Liveness:
    """Tells which cameras are waited for, by what the others give meanwhile.

    A camera is silent when capture time has gone on by three of its periods since its newest frame came. Its
    first frame makes it one of the living again.
    """

    def __init__(self, cameras: Sequence[str]):
        self._cameras = {name: LiveCamera() for name in cameras}
        self.now_ns: int | None = None  # capture time
        self._passed_ns = 0  # of capture time, without pauses

    def heard(self, name: str) -> tuple[Notice, ...]:
        """A frame of a camera has come that can be used, now or later."""
        camera = self._cameras[name]
        before, camera.heard_ns = camera.heard_ns, self._passed_ns
        if not camera.silent:
            return ()
        camera.silent = False
        away = "" if before is None else f" after {(self._passed_ns - before) / SECOND:.1f} s"
        return (Notice("sync.camera_back", "info", f"camera {name} gives frames{away}", {"camera": name}),)

    def took(self, name: str, stamp_ns: int) -> None:
        """A good frame of a camera, in master time."""
        camera = self._cameras[name]
        camera.recent.append(stamp_ns)
        if len(camera.recent) == SURE:
            self._go_on(min(camera.recent))

    def _go_on(self, until_ns: int) -> None:
        before = self.now_ns or until_ns
        self.now_ns = max(before, until_ns)
        if self.now_ns - before <= PAUSE_NS:
            self._passed_ns += self.now_ns - before

    def has_passed(self, instant: int, by_ns: int) -> bool:
        """Whether capture time is so much later than an instant."""
        return self.now_ns is not None and self.now_ns - instant > by_ns

    def find_silent(
        self, names: Iterable[str], least_ns: float, period_of: Callable[[str], float]
    ) -> tuple[Notice, ...]:
        """Tell of cameras that have become silent; each names its camera.

        Args:
            names: of the cameras that are still expected to give frames.
            least_ns: between their frames, at least. period_of: the same of one camera.
        """
        notices = []
        for name in names:
            camera = self._cameras[name]
            heard = camera.heard_ns
            waited = self._passed_ns - (heard or 0)
            if camera.silent or waited <= SILENT_PERIODS * least_ns:
                continue
            if waited <= SILENT_PERIODS * period_of(name):
                continue
            camera.silent = True
            since = "yet" if heard is None else f"for {waited / SECOND:.2f} s"
            text = f"camera {name} has given no usable frame {since}: sets do not wait for it"
            notices.append(Notice("sync.camera_silent", "warning", text, {"camera": name}))
        return tuple(notices)
