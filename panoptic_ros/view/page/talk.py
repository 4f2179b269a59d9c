"""What is said between the server and one page, over its WebSocket.

Texts are JSON. To the page: `facts` first, `health` twice a second (live), `presence` (recorded). From it:
`{"drawn": n}` after each live packet, `{"keys": [...]}` for topics of layers, `{"block": n}` for a second of
a recording, answered by a packet of that number.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from typing import Any

from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from panoptic_ros.errors import DataError
from panoptic_ros.view.page.live import LiveScene
from panoptic_ros.view.page.packets import Kind, pack
from panoptic_ros.view.page.recorded import RecordedScene
from panoptic_ros.view.page.server import as_json, asked_by, seconds

HEALTH_S = 0.5
WAITING = {"type": "waiting", "text": "waiting for /rig and /skeleton_model of a running graph"}


class LiveTalk:
    """Sends what a live scene has for a page, as fast as the page draws."""

    def __init__(self, scene: LiveScene):
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
                        await connection.send(pack(Kind.LIVE, number, messages))
                        number = (number + 1) % 2**32
                    changed.clear()
                    try:
                        await asyncio.wait_for(changed.wait(), left)
                    except asyncio.TimeoutError:  # not yet TimeoutError in Python 3.10
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


class RecordedTalk:
    """Answers for seconds of a recording; what a page asks for last is answered last, and nothing twice."""

    def __init__(self, scene: RecordedScene):
        self._scene = scene
        self._pages: list[ServerConnection] = []

    async def __call__(self, connection: ServerConnection) -> None:
        self._pages.append(connection)
        try:
            await connection.send(as_json(self._scene.facts()))
            await connection.send(as_json(self._presence()))
            async for said in asked_by(connection):
                number, keys = said.get("block"), said.get("keys", [])
                if isinstance(number, int) and isinstance(keys, list):
                    await self._block(connection, number, [str(key) for key in keys])
        except ConnectionClosed:
            return
        finally:
            self._pages.remove(connection)

    async def tell_presence(self) -> None:
        """Tell all pages who is there when, as far as that is known."""
        text = as_json(self._presence())
        for connection in list(self._pages):
            try:
                await connection.send(text)
            except ConnectionClosed:
                continue

    def _presence(self) -> dict[str, Any]:
        presence = self._scene.presence
        return {"type": "presence", "spans": presence.spans, "complete": presence.complete}

    async def _block(self, connection: ServerConnection, number: int, keys: Sequence[str]) -> None:
        try:
            await connection.send(await asyncio.to_thread(self._scene.block, number, keys))
        except DataError as error:
            await connection.send(as_json({"type": "problem", "text": str(error)}))
