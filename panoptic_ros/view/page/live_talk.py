"""WebSocket protocol between the server and one page of a live graph.

Text frames are JSON. The server sends `facts` first, then `health` twice a second. The page sends `{"drawn":
n}` after it has drawn a packet, and `{"keys": [...]}` to choose topics of layers.
"""

from __future__ import annotations

import asyncio
from typing import Any

from websockets.asyncio.server import ServerConnection

from panoptic_ros.view.page.live import LiveScene
from panoptic_ros.view.page.packets import PacketKind, pack
from panoptic_ros.view.page.server import as_json, asked_by, seconds

HEALTH_S = 0.5
WAITING = {"type": "waiting", "text": "waiting for /rig and /skeleton_model of a running graph"}


class LiveTalk:
    """Sender of a live scene's messages to one page, no faster than the page draws."""

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
