"""Clients of a live page, and what a scene exchanges with them across threads."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from panoptic_ros.graph.topics import ALWAYS_SHOWN
from panoptic_ros.view.page.mailbox import Mailbox
from panoptic_ros.view.page.packets import PageMessage


class Client:
    """State of one page: its mailbox, its topic keys, and the callback that wakes its sender."""

    def __init__(self, wake: Callable[[], None]):
        self.mailbox = Mailbox()
        self.keys: frozenset[str] = frozenset(ALWAYS_SHOWN)
        self.wake = wake


class PageScene:
    """Base of scenes: their clients, and the first document of a page."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._clients: list[Client] = []
        self._facts: dict[str, Any] | None = None

    def facts(self) -> dict[str, Any] | None:
        """Return the first document of a page, or None without a rig.

        The result is the same object until the document changes.
        """
        with self._lock:
            return self._facts

    def attach(self, wake: Callable[[], None]) -> Client:
        """Add a page; `wake` is called from any thread when there may be something to send."""
        client = Client(wake)
        with self._lock:
            self._clients.append(client)
        return client

    def detach(self, client: Client) -> None:
        """Remove a page."""
        with self._lock:
            self._clients.remove(client)

    def collect(self, client: Client) -> list[PageMessage] | None:
        """Return the messages to send to a client now, or None."""
        with self._lock:
            return client.mailbox.take()

    def drawn(self, client: Client) -> None:
        """Record that a page has drawn a packet."""
        with self._lock:
            client.mailbox.drawn()
