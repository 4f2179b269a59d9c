"""HTTP and WebSocket server of the viewer page and its data, on one port."""

from __future__ import annotations

import gzip
import json
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from typing import Any
from urllib.parse import urlsplit

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.export.access import Access
from panoptic_ros.view.page.html import page

MOST_ASKED = 4096  # bytes; largest message accepted from a page


Talk = Callable[[ServerConnection], Any]  # coroutine that serves one page


class PageServer:
    """Server of the viewer page. `talk` handles the WebSocket of every opened page.

    The address contains a required token, because the data shows people and the machine may have other users.
    See `Access` for the protection against pages of other sites.

    Args:
        talk: Coroutine that serves one WebSocket.
        host: Address to listen on.
        port: TCP port, 0 for any free one.
        document: The page; None = that of the viewer.
    """

    def __init__(self, talk: Talk, host: str = "127.0.0.1", port: int = 0, document: bytes | None = None):
        self._talk, self._host, self._port = talk, host, port
        self._access = Access(host)
        self._zipped = gzip.compress(document or page(), 6, mtime=0)

    @asynccontextmanager
    async def listening(self) -> AsyncIterator[str]:
        """Listen, and yield the address of the page.

        Raises:
            EnvironmentProblem: If the port is taken, or the host is not an address of this machine.
        """
        try:
            server = await serve(
                self._talk,
                self._host,
                self._port,
                process_request=self._answer,
                compression=None,
                max_size=MOST_ASKED,
                server_header=None,
            )
        except OSError as error:
            raise EnvironmentProblem(
                f"nothing can listen on {self._host}, port {self._port} ({error.strerror or error}); "
                "give another --port or --host"
            ) from None
        async with server:
            yield self._address(server)

    def _address(self, server: Server) -> str:
        port = next(iter(server.sockets)).getsockname()[1]
        return self._access.address("http", port)

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return the page, an error response, or None to continue with the WebSocket handshake."""
        address = urlsplit(request.path)
        if self._access.is_foreign(request.headers):
            return _response(403, "Forbidden", b"another site asked for this")
        if not self._access.has_token(request.path):
            return _response(403, "Forbidden", b"the address lacks the token that `panoptic` printed")
        if address.path == "/data":
            return None
        if address.path != "/":
            return _response(404, "Not Found", b"there is one page: /")
        if "gzip" in request.headers.get("Accept-Encoding", ""):
            return _response(200, "OK", self._zipped, "text/html; charset=utf-8", "gzip")
        return _response(200, "OK", gzip.decompress(self._zipped), "text/html; charset=utf-8")


def _response(
    status: int, reason: str, body: bytes, kind: str = "text/plain; charset=utf-8", encoding: str = ""
) -> Response:
    headers = Headers(
        {
            "Content-Type": kind,
            "Content-Length": str(len(body)),
            "Cache-Control": "no-store",
            "Connection": "close",
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
        }
    )
    if encoding:
        headers["Content-Encoding"] = encoding
    return Response(status, reason, headers, body)


def as_json(document: Any) -> str:
    """Return the document as compact JSON text."""
    return json.dumps(document, separators=(",", ":"))


async def asked_by(connection: ServerConnection) -> AsyncIterator[dict[str, Any]]:
    """Yield the JSON objects that a page sends until it disconnects; ignore all other text."""
    with suppress(ConnectionClosed):
        async for text in connection:
            with suppress(ValueError):
                said = json.loads(text)
                if isinstance(said, dict):
                    yield said


def seconds() -> float:
    """Return the time of a monotonic clock in s."""
    return time.monotonic()
