"""Live: track how far capture time has advanced, and which cameras are silent."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from panoptic_ros.stage import Notice

SECOND = 1_000_000_000
SURE = 3  # frames of one camera that confirm a time; one or two wrong timestamps close no set
SILENT_PERIODS = 3  # periods without a frame after which sets no longer wait for a camera
PAUSE_NS = 2 * SECOND  # ns; a longer step of capture time is a pause of all cameras


@dataclass
class LiveCamera:
    """Newest frames of one camera.

    Args:
        recent: (ns) newest timestamps.
        heard_ns: (ns) elapsed capture time when the newest frame arrived; None before the first frame.
        silent: True if the camera is silent.
    """

    recent: deque[int] = field(default_factory=lambda: deque(maxlen=SURE))
    heard_ns: int | None = None
    silent: bool = False


class Liveness:
    """Detector of silent cameras, which compares each camera with the capture time of the others.

    A camera is silent once capture time has advanced by three of its periods since its newest frame. Its next
    frame makes it active again.
    """

    def __init__(self, cameras: Sequence[str]):
        self._cameras = {name: LiveCamera() for name in cameras}
        self.now_ns: int | None = None  # ns, capture time so far
        self._passed_ns = 0  # ns of capture time that have elapsed, without pauses

    def heard(self, name: str) -> tuple[Notice, ...]:
        """Record that a camera has given a frame that is usable now or later."""
        camera = self._cameras[name]
        before, camera.heard_ns = camera.heard_ns, self._passed_ns
        if not camera.silent:
            return ()
        camera.silent = False
        away = "" if before is None else f" after {(self._passed_ns - before) / SECOND:.1f} s"
        return (
            Notice("sync.camera_back", "info", f"camera {name} sends frames again{away}", {"camera": name}),
        )

    def took(self, name: str, stamp_ns: int) -> None:
        """Record a good frame of a camera, with its timestamp in master time."""
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
        """Return whether capture time is later than an instant by more than `by_ns`."""
        return self.now_ns is not None and self.now_ns - instant > by_ns

    def find_silent(
        self, names: Iterable[str], least_ns: float, period_of: Callable[[str], float]
    ) -> tuple[Notice, ...]:
        """Return a notice for each camera that has become silent.

        Args:
            names: cameras that are still expected to give frames.
            least_ns: (ns) minimum period of the cameras.
            period_of: (ns) period of one camera, by name.
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
            text = f"camera {name} has sent no usable frame {since}: sets do not wait for it"
            notices.append(Notice("sync.camera_silent", "warning", text, {"camera": name}))
        return tuple(notices)
