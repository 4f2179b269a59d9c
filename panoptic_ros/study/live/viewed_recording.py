"""A recording that somebody opens and looks at here and there: how long that takes, without a browser."""

from __future__ import annotations

import asyncio
import json
import time
import urllib.request
from pathlib import Path
from typing import Any

import numpy as np
from websockets.asyncio.client import connect

from panoptic_ros.running.viewer.process import viewer
from panoptic_ros.view.page.recorded import BLOCK_NS

SEEKS = 40


def open_and_seek(path: Path, seed: int = 0) -> dict[str, Any]:
    """Open a recording, get the page and its first second, then seconds here and there.

    Returns:
        s from the command to the address, and to the first second of data; ms of seeks; seconds that it has.

    Raises:
        EnvironmentProblem: if the viewer does not start.
    """
    begun = time.perf_counter()
    with viewer([str(path)]) as (_, address):
        told = time.perf_counter() - begun
        urllib.request.urlopen(address).read()
        return {"address_s": told, **asyncio.run(_seek(address, begun, np.random.default_rng(seed)))}


async def _seek(address: str, begun: float, rng: np.random.Generator) -> dict[str, Any]:
    async with connect(address.replace("http", "ws") + "data", max_size=None, compression=None) as page:

        async def second(number: int) -> float:
            start = time.perf_counter()
            await page.send(json.dumps({"block": number, "keys": []}))
            while isinstance(await page.recv(), str):
                pass
            return time.perf_counter() - start

        facts = json.loads(await page.recv())
        count = max(1, (int(facts["end_ns"]) - int(facts["begin_ns"])) // BLOCK_NS)
        await second(0)
        first = time.perf_counter() - begun
        seeks = [1e3 * await second(int(number)) for number in rng.integers(0, count, SEEKS)]
    p50, p99 = np.percentile(seeks, (50, 99))
    return {
        "first_s": first,
        "seconds": count,
        "seeks": SEEKS,
        "seek_p50_ms": float(p50),
        "seek_p99_ms": float(p99),
        "seek_max_ms": max(seeks),
    }
