"""Clients of a live page without a page: how old what they get is, whatever they do with it.

`python -m panoptic_ros.view.page.clients ADDRESS SECONDS KIND ...` prints JSON, a row for each client. Kinds:
fast draws at once, slow takes 20 ms for each packet, frozen never draws, cut does not even read.
"""

from __future__ import annotations

import asyncio
import json
import sys
import time
from typing import Any

import numpy as np
from websockets.asyncio.client import connect

from panoptic_ros.view.page.packets import HEAD, MESSAGE
from panoptic_ros.view.page.peek import skeletons_head

SLOW_S = 0.02  # for one packet
WARM_S = 1.5  # that do not count


async def _client(address: str, kind: str, seconds: float) -> dict[str, Any]:
    """Look on for so long."""
    ages: list[float] = []
    size, dropped, until = 0, 0, time.monotonic() + WARM_S + seconds
    async with connect(address, max_size=None, compression=None) as page:
        topics: list[list[str]] = []
        while (left := until - time.monotonic()) > 0:
            if kind == "cut":
                await asyncio.sleep(left)
                break
            try:
                data = await asyncio.wait_for(page.recv(), left)
            except asyncio.TimeoutError:  # not yet TimeoutError in Python 3.10
                break
            now_ns = time.time_ns()
            if isinstance(data, str):
                said = json.loads(data)
                topics = said.get("topics", topics)
                dropped = said.get("page", {}).get("dropped", dropped)
                continue
            if kind == "frozen":
                continue
            if kind == "slow":
                await asyncio.sleep(SLOW_S)
                now_ns = time.time_ns()
            await page.send('{"drawn":0}')
            stamp = _newest(data, topics)
            if stamp is not None and until - time.monotonic() < seconds:
                size += len(data)
                ages.append(1e-6 * (now_ns - stamp))
        if kind == "cut":
            page.transport.abort()
    percentiles = np.percentile(ages, (50, 99)).tolist() if ages else [None, None]
    return {"kind": kind, "packets": len(ages), "age_p50_ms": percentiles[0], "age_p99_ms": percentiles[1],
            "age_max_ms": max(ages, default=None), "megabytes_per_s": 1e-6 * size / seconds,
            "skipped": dropped}  # fmt: skip


def _newest(packet: bytes, topics: list[list[str]]) -> int | None:
    """When the newest skeletons in a packet were published, ns: the bench writes that into them."""
    newest, at = None, HEAD.size
    while at < len(packet):
        topic, length, _ = MESSAGE.unpack_from(packet, at)
        begin = at + MESSAGE.size
        if topics[topic][0] == "skeletons":
            newest = max(newest or 0, skeletons_head(packet[begin : begin + length]).newest_ns)
        at = begin + length + -(MESSAGE.size + length) % 8
    return newest


async def look_on(address: str, seconds: float, kinds: list[str]) -> list[dict[str, Any]]:
    """All of them at once."""
    data = address.replace("http", "ws").replace("/?", "/data?") + ("" if "?" in address else "data")
    return list(await asyncio.gather(*(_client(data, kind, seconds) for kind in kinds)))


if __name__ == "__main__":
    print(json.dumps(asyncio.run(look_on(sys.argv[1], float(sys.argv[2]), sys.argv[3:]))))
