"""Access control of this program's servers: a token for clients, no requests from pages of other sites."""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Mapping
from urllib.parse import parse_qs, urlsplit

LOOPBACK = ("127.0.0.1", "::1", "localhost")  # host names of this machine that other machines cannot reach
EVERYWHERE = ("0.0.0.0", "::", "")  # hosts that mean all addresses of this machine


class Access:
    """Access rules of one server.

    A request from a page of another site is refused by its Origin header. If the server listens on this
    machine alone, a request for another host name is refused by its Host header (DNS rebinding). Other
    clients need the token.

    Args:
        host: host on which the server listens.
        open_here: programs on this machine need no token, if the server listens on it alone.
    """

    def __init__(self, host: str, open_here: bool = False):
        self._host, self._is_local = host, host in LOOPBACK
        self.token = "" if self._is_local and open_here else secrets.token_urlsafe(9)

    def address(self, scheme: str, port: int) -> str:
        """Return the address of the server with its token."""
        host = "<this machine's name>" if self._host in EVERYWHERE else self._host
        host = f"[{host}]" if ":" in host else host
        return f"{scheme}://{host}:{port}/" + (f"?token={self.token}" if self.token else "")

    def is_foreign(self, headers: Mapping[str, str]) -> bool:
        """Return whether a request comes from a page of another site, or is for another host name."""
        asked, origin = headers.get("Host", ""), headers.get("Origin")
        if self._is_local and _name(f"//{asked}") not in LOOPBACK:
            return True
        return origin is not None and _name(origin) not in LOOPBACK and urlsplit(origin).netloc != asked

    def has_token(self, path: str) -> bool:
        """Return whether the path of a request holds the token."""
        given = parse_qs(urlsplit(path).query).get("token", [""])[0]
        return hmac.compare_digest(given.encode(), self.token.encode())


def _name(address: str) -> str | None:
    """Return the host name of an address; None if it has none."""
    try:
        return urlsplit(address).hostname
    except ValueError:  # unbalanced bracket
        return None
