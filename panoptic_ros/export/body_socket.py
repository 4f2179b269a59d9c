"""Stream bodies over a WebSocket: every client gets the newest frame, at the rate that it can receive."""

from __future__ import annotations

import asyncio
import threading
from concurrent.futures import Future
from contextlib import suppress
from typing import Any

from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.export.access import Access

MOST_ASKED = 1024  # bytes that a client may send; the server expects no messages
REFUSED = 1008  # WebSocket close code for a connection without the token


class _Client:
    """The newest frame that a client has not received yet, or None."""

    def __init__(self) -> None:
        self.waiting: str | None = None
        self.changed = asyncio.Event()


class BodySocket:
    """WebSocket server in a separate thread.

    If it listens on this machine alone, clients need no token. Requests from pages of other sites are refused
    by their Origin header. Clients on other machines need a token in the address.

    Args:
        host: host to listen on.
        port: 0 = any free port.

    Raises:
        EnvironmentProblem: if the port is in use.
    """

    def __init__(self, host: str = "127.0.0.1", port: int = 0):
        self._host, self._port = host, port
        self._access = Access(
            host, open_here=True
        )  # game engines store the address, and joint positions are less private than images
        self._hello: str | None = None
        self._clients: set[_Client] = set()
        self._loop = asyncio.new_event_loop()
        self._over = asyncio.Event()
        started: Future[int] = Future()
        self._thread = threading.Thread(target=self._run, args=(started,), daemon=True)
        self._thread.start()
        try:
            self.port = started.result()
        except OSError as error:
            raise EnvironmentProblem(
                f"nothing can listen on {host}, port {port} ({error.strerror or error}); choose another "
                "`stream_port`"
            ) from None

    @property
    def address(self) -> str:
        """Return the address for clients."""
        return self._access.address("ws", self.port)

    @property
    def watched(self) -> bool:
        """Return whether there are clients."""
        return bool(self._clients)

    def begin(self, hello: str) -> None:
        """Set the first message for every client; frames are only sent after it."""
        self._hello = hello

    def offer(self, instant: str) -> None:
        """Queue the newest frame for all clients; it replaces a frame that a client has not received yet."""
        with suppress(RuntimeError):  # the event loop has ended
            self._loop.call_soon_threadsafe(self._spread, instant)

    def close(self) -> None:
        """End all connections."""
        with suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._over.set)
        self._thread.join(timeout=5.0)

    def _spread(self, instant: str) -> None:
        for client in self._clients:
            client.waiting = instant
            client.changed.set()

    def _run(self, started: Future[int]) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.run_until_complete(self._serve(started))
        self._loop.close()

    async def _serve(self, started: Future[int]) -> None:
        try:
            server = await serve(
                self._talk,
                self._host,
                self._port,
                compression=None,
                max_size=MOST_ASKED,
                server_header=None,
                process_request=self._refusal,
            )
        except OSError as error:
            started.set_exception(error)
            return
        async with server:
            started.set_result(int(next(iter(server.sockets)).getsockname()[1]))
            await self._over.wait()

    def _refusal(self, connection: ServerConnection, request: Request) -> Response | None:
        if self._access.is_foreign(request.headers):
            return connection.respond(403, "another site asked for this\n")
        return None

    async def _talk(self, connection: ServerConnection) -> None:
        request: Any = connection.request
        if not self._access.has_token(request.path):
            await connection.close(REFUSED, "the address lacks its token")
            return
        client = _Client()
        self._clients.add(client)
        sender = asyncio.create_task(self._send(connection, client))
        try:
            await connection.wait_closed()
        finally:
            self._clients.discard(client)
            sender.cancel()

    async def _send(self, connection: ServerConnection, client: _Client) -> None:
        """Send the waiting messages of a client until the connection ends."""
        told = False
        with suppress(ConnectionClosed):
            while True:
                await client.changed.wait()
                client.changed.clear()
                instant, client.waiting = client.waiting, None
                if not told and self._hello is not None:
                    await connection.send(self._hello)
                    told = True
                if told and instant is not None:
                    await connection.send(instant)
