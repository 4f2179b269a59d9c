"""What is said between the server and one page of a recording, over its WebSocket.

Texts are JSON. To the page: `facts` first, then `presence` as far as it is known. From it: `{"block": n}` for
a second of the recording, with the `keys` of layers' topics, answered by a packet of that number, or by a
`problem` that names the `block`.
"""

from __future__ import annotations

import asyncio
from collections.abc import Collection, Sequence
from typing import Any, Protocol

from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed
from websockets.protocol import State

from panoptic_ros.errors import UserError
from panoptic_ros.view.page.presence import Presence
from panoptic_ros.view.page.server import as_json, asked_by

LOOK_S = 0.05  # between looks at a second that is not read yet


class Shown(Protocol):
    """A recording: `recorded.RecordedScene`, `folder.FolderScene`."""

    presence: Presence

    def facts(self) -> dict[str, Any]:
        """What a page is told first."""

    def block(self, number: int, keys: Collection[str] = ()) -> bytes:
        """A packet of one second."""

    def has(self, number: int) -> bool:
        """Return whether a second can be given, or refused, at once."""


class RecordedTalk:
    """Answers for seconds of a recording; what a page asks for last is answered last, and nothing twice."""

    def __init__(self, scene: Shown):
        self._scene = scene
        self._pages: list[ServerConnection] = []
        self.shown = asyncio.Event()  # a page has been sent its first second

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
        while not self._scene.has(number):  # here and not in a thread, of which there are few
            if connection.state is not State.OPEN:
                return
            await asyncio.sleep(LOOK_S)
        try:
            await connection.send(await asyncio.to_thread(self._scene.block, number, keys))
        except UserError as error:
            await connection.send(as_json({"type": "problem", "text": str(error), "block": number}))
        self.shown.set()
