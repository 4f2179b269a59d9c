"""The live graph as a scene: takes raw messages, and hands every client the newest."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from panoptic_ros.domain import Rig, SkeletonModel
from panoptic_ros.errors import DataError
from panoptic_ros.graph.topics import ALWAYS_SHOWN, ASKED_FOR, TOPICS
from panoptic_ros.view.page.facts import PageTopic, SceneFacts
from panoptic_ros.view.page.health import Health
from panoptic_ros.view.page.mailbox import Instant, Mailbox
from panoptic_ros.view.page.packets import Message
from panoptic_ros.view.page.pairing import Pairing
from panoptic_ros.view.page.peek import stamp_of_bytes


class Client:
    """One page: its mailbox, what it shows, and what wakes the one who sends."""

    def __init__(self, wake: Callable[[], None]):
        self.mailbox = Mailbox()
        self.keys: frozenset[str] = frozenset(ALWAYS_SHOWN)
        self.wake = wake


class LiveScene:
    """Between the thread that takes messages and the one that serves pages.

    Whoever feeds it need not subscribe to anything that `wanted` does not name: without a page nothing is
    asked of the graph.
    """

    kind = "live"

    def __init__(self, title: str = "live graph") -> None:
        self._title = title
        self._lock = threading.Lock()
        self._clients: list[Client] = []
        self._pairing = Pairing()
        self._places: dict[tuple[str, str], int] = {}
        self._rig: Rig | None = None
        self._facts: dict[str, Any] | None = None
        self.health = Health()
        self.bad_messages = 0

    # ------------------------------------------------------------- fed by a node

    def begin(self, rig: Rig, skeleton: SkeletonModel) -> None:
        """The cameras and the skeleton are known, or are others now."""
        topics = [
            PageTopic(key, owner, TOPICS[key].message)
            for key in (*ALWAYS_SHOWN, *ASKED_FOR)
            for owner in (rig.names if TOPICS[key].scope == "camera" else ("",))
        ]
        with self._lock:
            self._rig = rig
            self._facts = SceneFacts("live", self._title, rig, skeleton, topics).document()
            self._places = {(topic.key, topic.owner): place for place, topic in enumerate(topics)}
            self._pairing = Pairing()

    def wanted(self) -> frozenset[str]:
        """Keys of the topics that clients show now."""
        with self._lock:
            return frozenset[str]().union(*(client.keys for client in self._clients))

    def take(self, key: str, owner: str, data: bytes, now_s: float, wall_ns: int) -> None:
        """A message of a topic, as CDR bytes; what cannot be used is counted."""
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
        """What a node says of itself: {name, level, message, owner, values}."""
        with self._lock:
            self.health.statuses[name] = status

    def _instant(self, key: str, owner: str, data: bytes, now_s: float, wall_ns: int) -> Instant | None:
        place = self._places.get((key, owner))
        if place is None:
            return None
        message = Message(place, data)
        if key == "preview":
            return self._pairing.preview(owner, message, now_s)
        if key == "detections":
            self.health.arrived(owner, now_s)
            return self._pairing.detections(owner, message, now_s)
        if key != "skeletons":
            return Instant(None, {}, (message,))
        self.health.arrived("", now_s)
        self.health.published(stamp_of_bytes(data), wall_ns)
        return self._pairing.skeletons(message, now_s)

    # ------------------------------------------------------------- asked by a server

    def facts(self) -> dict[str, Any] | None:
        """What a page is told first, the same object as long as it holds; None before the rig has come."""
        with self._lock:
            return self._facts

    def attach(self, wake: Callable[[], None]) -> Client:
        """A page has come; `wake` is called, from any thread, when there may be something to send."""
        client = Client(wake)
        with self._lock:
            self._clients.append(client)
        return client

    def detach(self, client: Client) -> None:
        """A page is gone."""
        with self._lock:
            self._clients.remove(client)

    def choose(self, client: Client, keys: Sequence[str]) -> None:
        """Which topics a page shows besides those that it always has."""
        with self._lock:
            client.keys = frozenset((*ALWAYS_SHOWN, *(key for key in keys if key in ASKED_FOR)))

    def collect(self, client: Client) -> list[Message] | None:
        """What to send to a client now, if anything."""
        with self._lock:
            return client.mailbox.take()

    def drawn(self, client: Client) -> None:
        """A page has drawn a packet."""
        with self._lock:
            client.mailbox.drawn()

    def state(self, client: Client, now_s: float) -> dict[str, Any]:
        """How the graph and this page are."""
        with self._lock:
            names = () if self._rig is None else self._rig.names
            document = self.health.document(names, now_s)
            return {**document, "page": {"dropped": client.mailbox.dropped, "bad": self.bad_messages}}
