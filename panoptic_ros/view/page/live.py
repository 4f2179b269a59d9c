"""Scene of the live graph: it receives raw messages and hands the newest instant to every client.

Rates, ages and latency are measured where messages arrive, because a slow browser would report cameras as
silent. Messages of one instant are paired: skeletons, the 2D poses that they rest on, and the images of
these.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeVar

from panoptic_ros.domain import Rig, SkeletonModel
from panoptic_ros.errors import DataError
from panoptic_ros.graph.topics import ALWAYS_SHOWN, ASKED_FOR, TOPICS
from panoptic_ros.view.page.facts import PageTopic, SceneFacts
from panoptic_ros.view.page.mailbox import PageInstant
from panoptic_ros.view.page.packets import PageMessage
from panoptic_ros.view.page.peek import detections_head, skeletons_head, stamp_of_bytes
from panoptic_ros.view.page.scene import Client, PageScene

WINDOW_S = 2.0  # s; window over which rates are counted
PLAUSIBLE_S = 60.0  # s; a timestamp farther from the wall clock than this belongs to another clock
Kept = TypeVar("Kept")
KEPT_VIEWS = 128  # detections kept per camera: two seconds at 60 Hz, longer than the skeletons' latency
KEPT_PREVIEWS = 32
# ns; largest time difference between skeletons that do not name their views and detections of the same
# instant
NEAR_NS = 25_000_000
PATIENCE_S = 1.0  # s without skeletons, after which views are shown alone


class MessagePairing:
    """Pairing of live messages by timestamp and frame number, not by arrival.

    Skeletons name the frame of every view that they rest on. The detections and the preview of that frame
    have the timestamp of its image.
    """

    def __init__(self) -> None:
        self._previews: dict[str, dict[int, PageMessage]] = {}  # by camera and timestamp
        self._stamps: dict[str, dict[int, int]] = {}  # by camera and frame number
        self._people: dict[str, dict[int, PageMessage]] = {}  # by camera and timestamp
        self._skeletons_at = float("-inf")

    def preview(self, camera: str, message: PageMessage, now_s: float) -> PageInstant | None:
        """Add an image preview and return an instant to show if no skeletons arrive.

        Raises:
            DataError: If the message cannot be read as such.
        """
        stamp = stamp_of_bytes(message.data)
        _keep(self._previews.setdefault(camera, {}), stamp, message, KEPT_PREVIEWS)
        return self._alone(camera, stamp, now_s)

    def detections(self, camera: str, message: PageMessage, now_s: float) -> PageInstant | None:
        """Add the detections of an image and return an instant as `preview` does.

        Raises:
            DataError: If the message cannot be read as such.
        """
        stamp, frame = detections_head(message.data)
        _keep(self._people.setdefault(camera, {}), stamp, message, KEPT_VIEWS)
        _keep(self._stamps.setdefault(camera, {}), frame, stamp, KEPT_VIEWS)
        return self._alone(camera, stamp, now_s)

    def skeletons(self, message: PageMessage, now_s: float) -> PageInstant:
        """Return the instant of a skeletons message, with the views that have an image.

        Raises:
            DataError: If the message cannot be read as skeletons.
        """
        self._skeletons_at = now_s
        head, views = skeletons_head(message.data), {}
        if head.frames:
            stamps = {camera: self._stamps.get(camera, {}).get(n) for camera, n in head.frames.items()}
        else:  # these skeletons do not name their views
            stamps = {camera: _nearest(kept, head.stamp_ns) for camera, kept in self._people.items()}
        for camera, stamp in stamps.items():
            preview = self._previews.get(camera, {}).pop(-1 if stamp is None else stamp, None)
            if stamp is not None and preview is not None:
                views[camera] = (preview, self._people[camera][stamp])
        return PageInstant(message, views)

    def _alone(self, camera: str, stamp: int, now_s: float) -> PageInstant | None:
        if now_s - self._skeletons_at < PATIENCE_S or camera not in self._previews:
            return None
        preview, people = (kept.get(camera, {}).get(stamp) for kept in (self._previews, self._people))
        if preview is None:
            return None
        return PageInstant(None, {camera: (preview, people) if people is not None else (preview,)})


def _nearest(stamps: Iterable[int], stamp_ns: int) -> int | None:
    """Return the nearest timestamp within `NEAR_NS`, or None."""
    found = min(stamps, key=lambda stamp: abs(stamp - stamp_ns), default=None)
    return found if found is not None and abs(found - stamp_ns) <= NEAR_NS else None


def _keep(items: dict[int, Kept], key: int, value: Kept, limit: int) -> None:
    """Store a value and drop the oldest values beyond the limit."""
    items[key] = value
    while len(items) > limit:
        del items[next(iter(items))]


class MessageStatistics:
    """Rates, ages and latency of incoming messages, and the status messages of nodes."""

    def __init__(self) -> None:
        self._arrivals: dict[str, deque[float]] = {}
        self._latest: dict[str, float] = {}
        self._latencies: deque[float] = deque(maxlen=300)
        self.statuses: dict[str, Mapping[str, Any]] = {}  # by name, as on /diagnostics

    def arrived(self, name: str, now_s: float) -> None:
        """Record the arrival of a message of a camera, or of the skeletons (name "")."""
        times = self._arrivals.setdefault(name, deque())
        times.append(now_s)
        while times[0] < now_s - WINDOW_S:
            times.popleft()
        self._latest[name] = now_s

    def published(self, stamp_ns: int, wall_ns: int) -> None:
        """Record the latency of skeletons; ignore timestamps that are implausible for the wall clock."""
        latency = (wall_ns - stamp_ns) * 1e-9
        if 0.0 <= latency < PLAUSIBLE_S:
            self._latencies.append(latency)

    def document(self, cameras: Sequence[str], now_s: float) -> dict[str, Any]:
        """Return the health as a JSON document.

        Latency counts from capture to arrival, in ms. Ages are in s, null before the first message.
        """
        latencies = sorted(self._latencies)
        return {
            "type": "health",
            "cameras": {name: self._of(name, now_s) for name in cameras},
            "skeletons": self._of("", now_s),
            "latency_ms": [1e3 * latencies[round(q * (len(latencies) - 1))] for q in (0.5, 0.99)]
            if latencies
            else None,
            "statuses": list(self.statuses.values()),
        }

    def _of(self, name: str, now_s: float) -> dict[str, Any]:
        recent = sum(time > now_s - WINDOW_S for time in self._arrivals.get(name, ()))
        age = now_s - self._latest[name] if name in self._latest else None
        return {"rate_hz": recent / WINDOW_S, "age_s": age}


class LiveScene(PageScene):
    """Exchange between the thread that receives messages and the thread that serves pages.

    The feeding node needs to subscribe only to topics that `wanted` returns. Without a page, it subscribes to
    nothing.
    """

    kind = "live"

    def __init__(self, title: str = "live graph") -> None:
        self._title = title
        super().__init__()
        self._pairing = MessagePairing()
        self._places: dict[tuple[str, str], int] = {}
        self._rig: Rig | None = None
        self.health = MessageStatistics()
        self.bad_messages = 0

    # ------------------------------------------------------------- called by the feeding node

    def begin(self, rig: Rig, skeleton: SkeletonModel) -> None:
        """Set the rig and the skeleton, at the start or after a change."""
        topics = [
            PageTopic(key, owner, TOPICS[key].message)
            for key in (*ALWAYS_SHOWN, *ASKED_FOR)
            for owner in (rig.names if TOPICS[key].scope == "camera" else ("",))
        ]
        with self._lock:
            self._rig = rig
            self._facts = SceneFacts("live", self._title, rig, skeleton, topics).document()
            self._places = {(topic.key, topic.owner): place for place, topic in enumerate(topics)}
            self._pairing = MessagePairing()

    def wanted(self) -> frozenset[str]:
        """Return the keys of the topics that clients show now."""
        with self._lock:
            return frozenset[str]().union(*(client.keys for client in self._clients))

    def take(self, key: str, owner: str, data: bytes, now_s: float, wall_ns: int) -> None:
        """Take a message of a topic as CDR bytes; count it as bad if it cannot be used."""
        with self._lock:
            try:
                instant = self._instant(key, owner, data, now_s, wall_ns)
            except DataError:
                self.bad_messages += 1
                return
            if instant is not None:
                for client in self._clients:
                    client.mailbox.offer(instant)
                    client.wake()

    def tell(self, name: str, status: Mapping[str, Any]) -> None:
        """Store the status of a node: {name, level, message, owner, values}."""
        with self._lock:
            self.health.statuses[name] = status

    def _instant(self, key: str, owner: str, data: bytes, now_s: float, wall_ns: int) -> PageInstant | None:
        place = self._places.get((key, owner))
        if place is None:
            return None
        message = PageMessage(place, data)
        if key == "preview":
            return self._pairing.preview(owner, message, now_s)
        if key == "detections":
            self.health.arrived(owner, now_s)
            return self._pairing.detections(owner, message, now_s)
        if key != "skeletons":
            return PageInstant(None, {}, (message,))
        self.health.arrived("", now_s)
        self.health.published(stamp_of_bytes(data), wall_ns)
        return self._pairing.skeletons(message, now_s)

    # ------------------------------------------------------------- called by the server

    def choose(self, client: Client, keys: Sequence[str]) -> None:
        """Set the topics that a page shows in addition to those that are always shown."""
        with self._lock:
            client.keys = frozenset((*ALWAYS_SHOWN, *(key for key in keys if key in ASKED_FOR)))

    def state(self, client: Client, now_s: float) -> dict[str, Any]:
        """Return the health of the graph, with the drop count of this page and the number of bad messages."""
        with self._lock:
            names = () if self._rig is None else self._rig.names
            document = self.health.document(names, now_s)
            return {**document, "page": {"dropped": client.mailbox.dropped, "bad": self.bad_messages}}
