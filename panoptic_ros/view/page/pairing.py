"""Which messages show one instant: skeletons, the 2D people that they rest on, and the images of these."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeVar

from panoptic_ros.view.page.mailbox import Instant
from panoptic_ros.view.page.packets import Message
from panoptic_ros.view.page.peek import detections_head, skeletons_head, stamp_of_bytes

Kept = TypeVar("Kept")
KEPT_VIEWS = 128  # 2D people of a camera: two seconds at 60 Hz, longer than skeletons take
KEPT_PREVIEWS = 32
NEAR_NS = 25_000_000  # between skeletons that do not name their views and 2D people of the same instant
PATIENCE_S = 1.0  # without skeletons, after which views are shown by themselves


class Pairing:
    """Pairs what comes from the live graph, by stamps and frame numbers, not by arrival.

    Skeletons name the frame of every view that they rest on; the 2D people of that frame have the stamp of
    its image, as its preview has.
    """

    def __init__(self) -> None:
        self._previews: dict[str, dict[int, Message]] = {}  # by camera and stamp
        self._stamps: dict[str, dict[int, int]] = {}  # by camera and frame number
        self._people: dict[str, dict[int, Message]] = {}  # by camera and stamp
        self._skeletons_at = float("-inf")

    def preview(self, camera: str, message: Message, now_s: float) -> Instant | None:
        """An image has come; something to show if nobody makes skeletons.

        Raises:
            DataError: if it is no such message.
        """
        stamp = stamp_of_bytes(message.data)
        _keep(self._previews.setdefault(camera, {}), stamp, message, KEPT_PREVIEWS)
        return self._alone(camera, stamp, now_s)

    def detections(self, camera: str, message: Message, now_s: float) -> Instant | None:
        """The 2D people of an image have come; as `preview`.

        Raises:
            DataError: if it is no such message.
        """
        stamp, frame = detections_head(message.data)
        _keep(self._people.setdefault(camera, {}), stamp, message, KEPT_VIEWS)
        _keep(self._stamps.setdefault(camera, {}), frame, stamp, KEPT_VIEWS)
        return self._alone(camera, stamp, now_s)

    def skeletons(self, message: Message, now_s: float) -> Instant:
        """Skeletons have come: the instant, with the views of which there is an image.

        Raises:
            DataError: if it is no such message.
        """
        self._skeletons_at = now_s
        head, views = skeletons_head(message.data), {}
        if head.frames:
            stamps = {camera: self._stamps.get(camera, {}).get(n) for camera, n in head.frames.items()}
        else:  # they do not name their views
            stamps = {camera: _nearest(kept, head.stamp_ns) for camera, kept in self._people.items()}
        for camera, stamp in stamps.items():
            preview = self._previews.get(camera, {}).pop(-1 if stamp is None else stamp, None)
            if stamp is not None and preview is not None:
                views[camera] = (preview, self._people[camera][stamp])
        return Instant(message, views)

    def _alone(self, camera: str, stamp: int, now_s: float) -> Instant | None:
        if now_s - self._skeletons_at < PATIENCE_S or camera not in self._previews:
            return None
        preview, people = (kept.get(camera, {}).get(stamp) for kept in (self._previews, self._people))
        if preview is None:
            return None
        return Instant(None, {camera: (preview, people) if people is not None else (preview,)})


def _nearest(stamps: Iterable[int], stamp_ns: int) -> int | None:
    """The nearest stamp that can be of the same instant."""
    found = min(stamps, key=lambda stamp: abs(stamp - stamp_ns), default=None)
    return found if found is not None and abs(found - stamp_ns) <= NEAR_NS else None


def _keep(items: dict[int, Kept], key: int, value: Kept, limit: int) -> None:
    """Remember a value, and forget the oldest beyond a limit."""
    items[key] = value
    while len(items) > limit:
        del items[next(iter(items))]
