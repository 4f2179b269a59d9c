"""Serve a page in a thread, beside work in the main thread."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from panoptic_ros.errors import PanopticError
from panoptic_ros.view.page.server import PageServer, Talk

LOOK_S = 0.1


@contextmanager
def served(talk: Talk, host: str, port: int, document: bytes) -> Iterator[str]:
    """Serve a page, and yield its address.

    Raises:
        EnvironmentProblem: if the address cannot be opened for listening.
    """
    ready, over = threading.Event(), threading.Event()
    addresses: list[str] = []
    faults: list[PanopticError] = []

    async def serve() -> None:
        async with PageServer(talk, host, port, document).listening() as address:
            addresses.append(address)
            ready.set()
            while not over.is_set():
                await asyncio.sleep(LOOK_S)

    def run() -> None:
        try:
            asyncio.run(serve())
        except PanopticError as error:
            faults.append(error)
        finally:
            ready.set()

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    ready.wait()
    try:
        if faults:
            raise faults[0]
        yield addresses[0]
    finally:
        over.set()
        thread.join(5.0)
