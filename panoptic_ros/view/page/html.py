"""Pages as self-contained HTML documents, either served or saved as a file with embedded data."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

STATIC = Path(__file__).parent / "static"
_DATA = "<!-- data -->"


VIEWER, GUIDE = "index.html", "guide.html"  # page of results and graphs, and of the calibration guide


def page(data: Mapping[str, Any] | None = None, name: str = VIEWER) -> bytes:
    """Return the HTML document, UTF-8.

    An import map embeds all JavaScript modules, because a page opened from a file may not load others.

    Args:
        data: Data of a page without a server: `facts`, `health` and `blocks` (base64). None makes the page
            request data from the server that delivered it.
        name: `VIEWER` or `GUIDE`.
    """
    html = (STATIC / name).read_text()
    html = html.replace("/* style */", (STATIC / "style.css").read_text())
    html = html.replace("<!-- modules -->", f'<script type="importmap">{json.dumps(_import_map())}</script>')
    text = "" if data is None else _script(data)
    return html.replace(_DATA, text).encode()


def _import_map() -> Mapping[str, Any]:
    """Return {"imports": {"#view/lens.js": "data:text/javascript;base64,..."}} for all modules."""
    modules = {
        f"#view/{path.relative_to(STATIC).as_posix()}": _data_address(path)
        for path in sorted(STATIC.rglob("*.js"))
    }
    return {"imports": modules}


def _data_address(path: Path) -> str:
    return "data:text/javascript;base64," + base64.b64encode(path.read_bytes()).decode()


def _script(data: Mapping[str, Any]) -> str:
    """Return the data as JSON in a script element, with "</" escaped because it would end the element."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("</", "<\\/")
    return f'<script type="application/json" id="data">{text}</script>'
