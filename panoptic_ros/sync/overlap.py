"""Recordings: find cameras whose frames lie at another time than those of most cameras.

Recordings have no arrival times. A camera may begin later or end earlier than others. But frames of a single
camera give no 3D poses. Two signs show a wrong time: a first frame far from those of the others, and no frame
near one of another camera.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from panoptic_ros.domain import ViewDetections
from panoptic_ros.stage import Notice

SECOND = 1_000_000_000
APART_NS = 60 * SECOND  # ns; cameras of one take are started within a minute


class Overlap:
    """Record of the cameras that have been in a set with other cameras.

    Args:
        cameras: names, in rig order.
    """

    def __init__(self, cameras: Sequence[str]):
        self._cameras = tuple(cameras)
        self._joined: set[str] = set()  # cameras that were in a set with another camera
        self._apart: set[str] = set()  # cameras that begin far from the others and have not joined them
        self._told: set[str] = set()
        self.started = False
        self._begin = 0  # first timestamp of most cameras

    def start(self, firsts: Mapping[str, int]) -> list[Notice]:
        """Compare the first timestamps of the cameras; return notices on those far from the majority."""
        self.started = True
        ordered = sorted(firsts.values())
        groups = [[s for s in ordered[k:] if s - first <= APART_NS] for k, first in enumerate(ordered)]
        size = max(map(len, groups), default=0)
        most = [(group[0], group[-1]) for group in groups if len(group) == size]
        in_order = [firsts[name] for name in self._cameras if name in firsts]
        begin, end = next(((a, b) for first in in_order for a, b in most if a <= first <= b), (0, 0))
        self._apart = {name for name, first in firsts.items() if not begin <= first <= end}
        self._begin = begin
        found = []
        for name in (name for name in self._cameras if name in self._apart):
            offset = firsts[name] - begin
            whose = (
                "those of most cameras"
                if 2 * size > len(firsts)
                else (
                    f"those of camera {' and '.join(n for n in firsts if n not in self._apart)}, which come "
                    "first in the rig"
                )
            )
            found.append(self._tell(name, offset, whose))
        return found

    def is_apart(self, camera: str) -> bool:
        """Return whether a camera begins far from the others and has not joined them."""
        return camera in self._apart

    def is_early(self, view: ViewDetections, reach: float = SECOND) -> bool:
        """Return whether a frame of a camera that is apart precedes the frames of most cameras."""
        return view.camera in self._apart and view.stamp_ns < self._begin - reach

    def closes(self, views: Sequence[ViewDetections], others_over: bool) -> tuple[bool, list[Notice]]:
        """Update from the views of a set; return whether the set may be published, and notices.

        Args:
            others_over: True if all cameras without a view in the set have ended.
        """
        names = {view.camera for view in views}
        if names - self._apart and len(names) > 1:
            self._joined |= names
            self._apart -= names
            return True, []
        if names <= self._apart and names:
            return False, []
        alone = len(names) == 1 and others_over and bool(self._joined) and not names <= self._joined
        if not alone:
            return True, []
        (view,) = views
        return False, [] if view.camera in self._told else [self._tell(view.camera, None, "")]

    def _tell(self, camera: str, offset: int | None, whose: str) -> Notice:
        self._told.add(camera)
        if offset is None:
            text = (
                f"all frames of camera {camera} lie after those of the other cameras: they are left out; "
                "correct its stamps, e.g. in timestamps.csv"
            )
        else:
            side = "after" if offset > 0 else "before"
            text = (
                f"frames of camera {camera} begin {abs(offset) / SECOND:.1f} s {side} {whose}: they are left "
                "out where these have none; correct its stamps, e.g. in timestamps.csv"
            )
        return Notice("sync.clock_off", "warning", text, {"camera": camera, "device": camera})
