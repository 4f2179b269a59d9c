"""A headless Chromium that tests look into, spoken to over its debugging protocol."""

from __future__ import annotations

import base64
import json
import os
import re
import shutil
import subprocess
import time
from contextlib import suppress
from pathlib import Path
from urllib.parse import urlsplit

from websockets.sync.client import connect

FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--disable-component-update",
    "--no-first-run",
    "--mute-audio",
    "--remote-debugging-port=0",
    "--remote-allow-origins=*",
)

BAD = ("error", "warning", "assert")  # words of a console


def find_browser() -> str | None:
    """The program, if one is installed."""
    names = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
    return next(filter(None, map(shutil.which, names)), None)


class Browser:
    """A browser without a window; a context manager.

    Args:
        profile: an empty folder.
    """

    def __init__(self, profile: Path, size: tuple[int, int] = (1400, 900)):
        self._process = subprocess.Popen(
            [str(find_browser()), *FLAGS, f"--user-data-dir={profile}", f"--window-size={size[0]},{size[1]}"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        self._size = size
        assert self._process.stderr is not None
        for line in self._process.stderr:
            found = re.search(r"listening on (ws://\S+)", line)
            if found:
                self._connection = connect(found[1], max_size=None, compression=None)
                self._socket = self._connection.__enter__()
                break
        else:
            raise RuntimeError("the browser did not start")
        self._count = 0
        self._events: list[dict] = []

    def open(self, address: str) -> Page:
        """A new page at an address."""
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        page = Page(self, session)
        for domain in ("Page", "Runtime", "Network", "Log"):
            page.call(f"{domain}.enable")
        width, height = self._size
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        page.call("Emulation.setDeviceMetricsOverride", **size)
        page.call("Page.navigate", url=address)
        return page

    def call(self, method: str, session: str | None = None, **params):
        """Ask for something; the answer."""
        self._count += 1
        message = {"id": self._count, "method": method, "params": params}
        if session is not None:
            message["sessionId"] = session
        self._socket.send(json.dumps(message))
        while True:
            answer = json.loads(self._socket.recv(timeout=60))
            if answer.get("id") == self._count:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                return answer["result"]
            self._events.append(answer)

    def events(self, session: str) -> list[dict]:
        """What has happened in a page so far."""
        self.call("Browser.getVersion")  # what came before is read then
        return [event for event in self._events if event.get("sessionId") == session]

    def processor_s(self) -> float:
        """Processor time of the browser with all of its processes, s."""
        tasks = {}  # by process: parent, ticks
        for path in Path("/proc").glob("[0-9]*/stat"):
            with suppress(OSError):
                fields = path.read_text().rsplit(")", 1)[1].split()
                tasks[int(path.parent.name)] = int(fields[1]), int(fields[11]) + int(fields[12])
        ours = {self._process.pid}
        while more := {task for task, (parent, _) in tasks.items() if parent in ours} - ours:
            ours |= more
        return sum(tasks[task][1] for task in ours) / os.sysconf("SC_CLK_TCK")

    def close(self) -> None:
        """End it."""
        self._connection.__exit__(None, None, None)
        self._process.terminate()
        self._process.wait(10)

    def __enter__(self) -> Browser:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


class Page:
    """One page of a browser."""

    def __init__(self, browser: Browser, session: str):
        self._browser, self._session = browser, session

    def call(self, method: str, **params):
        """See `Browser.call`."""
        return self._browser.call(method, self._session, **params)

    def evaluate(self, expression: str):
        """The value of an expression in the page, which may be a promise."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(f"{expression}: {answer['exceptionDetails']}")
        return answer["result"].get("value")

    def wait(self, expression: str, timeout_s: float = 30.0):
        """Wait until an expression is true; its value."""
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            value = self.evaluate(f"(() => {{ try {{ return {expression}; }} catch {{ return null; }} }})()")
            if value:
                return value
            time.sleep(0.02)
        raise TimeoutError(f"{expression}; the page says {self.complaints()}")

    def screenshot(self, path: Path) -> bytes:
        """A PNG of the window, also written to a file."""
        data = base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])
        Path(path).write_bytes(data)
        return data

    def click(self, x: float, y: float) -> None:
        """With the first button, at a place in the window."""
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def press(self, key: str, code: str = "") -> None:
        """A key."""
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, code=code or key)

    def complaints(self) -> list[str]:
        """Errors and warnings of the console, and exceptions that nobody caught."""
        found = []
        for event in self._browser.events(self._session):
            params = event.get("params", {})
            if event["method"] == "Runtime.exceptionThrown":
                details = params["exceptionDetails"]
                found.append(str(details.get("exception", {}).get("description", details["text"])))
            if event["method"] == "Runtime.consoleAPICalled" and params["type"] in BAD:
                words = (str(arg.get("value", arg.get("description"))) for arg in params["args"])
                found.append(" ".join(words))
            if event["method"] == "Log.entryAdded" and params["entry"]["level"] in ("error", "warning"):
                found.append(f"{params['entry']['text']} {params['entry'].get('url', '')}")
        return found

    def hosts(self) -> set[str]:
        """Whom the page has asked for anything over a network, by name."""
        found = set()
        for event in self._browser.events(self._session):
            params = event.get("params", {})
            if event["method"] == "Network.requestWillBeSent":
                found.add(urlsplit(params["request"]["url"]))
            if event["method"] == "Network.webSocketCreated":
                found.add(urlsplit(params["url"]))
        return {address.hostname for address in found if address.scheme in ("http", "https", "ws", "wss")}
