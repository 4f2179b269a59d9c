"""WebSocket protocol between the server and one page of a recording.

Text frames are JSON. The server sends `facts` first, then `presence` as the scan progresses. The page
requests one second of the recording with `{"block": n}` and the `keys` of its layers' topics. The server
answers with a packet of that number, or with a `problem` that names the `block`.
"""

from __future__ import annotations

import asyncio
from collections.abc import Collection, Sequence
from typing import Any, Protocol

from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed
from websockets.protocol import State

from panoptic_ros.errors import UserError
from panoptic_ros.view.page.presence import PresenceSpans
from panoptic_ros.view.page.server import as_json, asked_by

LOOK_S = 0.05  # s between checks for a second that is not read yet


class RecordedSceneProtocol(Protocol):
    """Interface of a recorded scene: `recorded.RecordedScene`, `folder.FolderScene`."""

    presence: PresenceSpans

    def facts(self) -> dict[str, Any]:
        """Return the first document that a page receives."""

    def block(self, number: int, keys: Collection[str] = ()) -> bytes:
        """Return the packet of one second."""

    def has(self, number: int) -> bool:
        """Return whether a request for a second can be answered or refused at once."""


class RecordedTalk:
    """Server side of pages of a recording. It answers each block request once, in the order of arrival."""

    def __init__(self, scene: RecordedSceneProtocol):
        self._scene = scene
        self._pages: list[ServerConnection] = []
        self.shown = asyncio.Event()  # set once a page has received its first block

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
        """Send the current presence spans to all pages."""
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
        # wait here, because a waiting thread would block the small thread pool
        while not self._scene.has(number):
            if connection.state is not State.OPEN:
                return
            await asyncio.sleep(LOOK_S)
        try:
            await connection.send(await asyncio.to_thread(self._scene.block, number, keys))
        except UserError as error:
            await connection.send(as_json({"type": "problem", "text": str(error), "block": number}))
        self.shown.set()
