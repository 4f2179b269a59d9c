"""The page as one HTML document that loads nothing else: served as it is, or a file with its data in it."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

STATIC = Path(__file__).parent / "static"
_DATA = "<!-- data -->"


def page(data: Mapping[str, Any] | None = None) -> bytes:
    """The document, UTF-8.

    Modules are named by an import map that holds them, as a page opened from a file may load no others.

    Args:
        data: what a page shows that has no server: `facts`, `health` and `blocks` (base64); None = it asks
            the server that it came from.
    """
    html = (STATIC / "index.html").read_text()
    html = html.replace("/* style */", (STATIC / "style.css").read_text())
    html = html.replace("<!-- modules -->", f'<script type="importmap">{json.dumps(_import_map())}</script>')
    text = "" if data is None else _script(data)
    return html.replace(_DATA, text).encode()


def _import_map() -> Mapping[str, Any]:
    """{"imports": {"#view/lens.js": "data:text/javascript;base64,..."}}, of all modules."""
    modules = {
        f"#view/{path.relative_to(STATIC).as_posix()}": _data_address(path)
        for path in sorted(STATIC.rglob("*.js"))
    }
    return {"imports": modules}


def _data_address(path: Path) -> str:
    return "data:text/javascript;base64," + base64.b64encode(path.read_bytes()).decode()


def _script(data: Mapping[str, Any]) -> str:
    """JSON in a script element, which "</" would end."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("</", "<\\/")
    return f'<script type="application/json" id="data">{text}</script>'
