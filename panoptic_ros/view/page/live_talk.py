"""WebSocket protocol between the server and one page of a live graph or of the calibration guide.

Text frames are JSON. The server sends `facts` first, then `health` twice a second. The page sends `{"drawn":
n}` after it has drawn a packet, and `{"keys": [...]}` to choose topics of layers.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

from websockets.asyncio.server import ServerConnection

from panoptic_ros.view.page.packets import PacketKind, PageMessage, pack
from panoptic_ros.view.page.scene import Client
from panoptic_ros.view.page.server import as_json, asked_by, seconds

HEALTH_S = 0.5
WAITING = {"type": "waiting", "text": "waiting for /rig and /skeleton_model of a running graph"}


class ServedScene(Protocol):
    """Scene that a page shows while it changes, see `LiveScene`."""

    def facts(self) -> dict[str, Any] | None:
        """Return the first document, or None before it is known."""

    def state(self, client: Client, now_s: float) -> Mapping[str, Any]:
        """Return the document that is sent twice a second."""

    def attach(self, wake: Callable[[], None]) -> Client:
        """Add a page."""

    def detach(self, client: Client) -> None:
        """Remove a page."""

    def collect(self, client: Client) -> list[PageMessage] | None:
        """Return the messages to send to a page now, or None."""

    def drawn(self, client: Client) -> None:
        """Record that a page has drawn a packet."""

    def choose(self, client: Client, keys: Sequence[str]) -> None:
        """Set the topics that a page shows."""


class LiveTalk:
    """Sender of a live scene's messages to one page, no faster than the page draws."""

    def __init__(self, scene: ServedScene):
        self._scene = scene

    async def __call__(self, connection: ServerConnection) -> None:
        loop, changed = asyncio.get_running_loop(), asyncio.Event()

        def wake() -> None:
            loop.call_soon_threadsafe(changed.set)

        client = self._scene.attach(wake)

        async def send() -> None:
            told: dict[str, Any] | None = None
            number = 0
            while True:
                facts = self._scene.facts()
                if facts is not told or facts is None:
                    told = facts
                    await connection.send(as_json(facts or WAITING))
                await connection.send(as_json(self._scene.state(client, seconds())))
                until = seconds() + HEALTH_S
                while (left := until - seconds()) > 0:
                    while (messages := self._scene.collect(client)) is not None:
                        await connection.send(pack(PacketKind.LIVE, number, messages))
                        number = (number + 1) % 2**32
                    changed.clear()
                    try:
                        await asyncio.wait_for(changed.wait(), left)
                    # asyncio.TimeoutError is not yet TimeoutError in Python 3.10
                    except asyncio.TimeoutError:
                        break

        sending = asyncio.create_task(send())
        try:
            async for said in asked_by(connection):
                if "drawn" in said:
                    self._scene.drawn(client)
                    changed.set()
                if isinstance(said.get("keys"), list):
                    self._scene.choose(client, [str(key) for key in said["keys"]])
        finally:
            self._scene.detach(client)
            sending.cancel()
            await asyncio.gather(sending, return_exceptions=True)
