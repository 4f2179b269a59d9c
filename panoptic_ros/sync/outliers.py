"""Remove single frames whose timestamps are far from those of the same camera before and after."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from panoptic_ros.domain import ViewDetections
from panoptic_ros.stage import Notice
from panoptic_ros.stamps.correction import LATEST_NS

SECOND = 1_000_000_000
FAR_NS = 2 * SECOND  # ns, minimum step between frames of a camera that means a pause, a jump or an outlier
PERIODS = 4  # the same limit for slow cameras, in frame periods
SURE = 3  # number of consecutive frames that confirm a pause or a jump


@dataclass
class StampGate:
    """Timestamps of one camera.

    Args:
        newest: (ns) timestamp of the newest accepted frame; None before the first.
        reach: (ns) maximum distance of the next frame from `newest`.
        off: waiting frames. Each is farther than `reach` from `newest`, and they follow each other plausibly.
    """

    newest: int | None = None
    reach: int = FAR_NS
    off: list[ViewDetections] = field(default_factory=list)


class StampOutliers:
    """Filter for frames whose timestamps are far off those of the same camera before and after.

    A frame more than `reach` (2 s or more) from the last accepted frame waits for the next two frames. If one
    of the two is near the last accepted frame, the waiting frame was an outlier. If all three follow each
    other plausibly, the camera paused or its clock jumped, and all three are passed. Otherwise the oldest
    waiting frame is dropped. The first frames of a camera also wait until three follow each other. The
    decision on a camera depends on the timestamps of that camera alone.
    """

    def __init__(self, cameras: Sequence[str]):
        self._cameras = {name: StampGate() for name in cameras}

    def take(self, view: ViewDetections) -> tuple[list[ViewDetections], list[Notice]]:
        """Add a frame; return the frames of its camera that are now accepted, and notices on outliers."""
        if view.stamp_ns >= LATEST_NS:
            return [], [_outlier(view)]
        camera = self._cameras[view.camera]
        if camera.newest is not None and abs(view.stamp_ns - camera.newest) <= camera.reach:
            outliers, camera.off, camera.newest = camera.off, [], view.stamp_ns
            return [view], [_outlier(each) for each in outliers]
        camera.off.append(view)
        notices = []
        while not _in_a_row(_steps(camera.off)):
            notices.append(_outlier(camera.off.pop(0)))
        if len(camera.off) < SURE:
            return [], notices
        camera.reach = max(FAR_NS, PERIODS * min(_steps(camera.off)))
        released, camera.off, camera.newest = camera.off, [], view.stamp_ns
        return released, notices

    def end(self, name: str) -> tuple[list[ViewDetections], list[Notice]]:
        """End a camera: pass its waiting frames if none of its frames was accepted, otherwise drop them."""
        camera = self._cameras[name]
        waiting, camera.off = camera.off, []
        if camera.newest is None:
            return waiting, []
        return [], [_outlier(view) for view in waiting]


def _steps(views: Sequence[ViewDetections]) -> list[int]:
    return [later.stamp_ns - view.stamp_ns for view, later in pairwise(views)]


def _in_a_row(steps: Sequence[int]) -> bool:
    """Return whether timestamps increase by steps that are plausible for one camera."""
    return not steps or (min(steps) > 0 and max(steps) <= max(FAR_NS, PERIODS * min(steps)))


def _outlier(view: ViewDetections) -> Notice:
    text = (
        f"frame {view.frame_number} of camera {view.camera} at {view.stamp_ns} ns was dropped: "
        "its stamp is an outlier among those of its camera before and after"
    )
    return Notice("sync.stray_stamp", "warning", text, {"camera": view.camera, "stamp_ns": view.stamp_ns})
