"""Test clients of a live page without a browser, to measure what each receives and when.

`python -m panoptic_ros.view.page.clients ADDRESS SECONDS KIND ...` prints JSON with one row per client. The
list "came" has one pair per packet, in ns: the timestamp of its newest skeletons, and the time of its arrival
or drawing. Kinds: "fast" draws at once, "slow" takes 20 ms per packet, "frozen" never draws, "cut" does not
even read.
"""

from __future__ import annotations

import asyncio
import json
import sys
import time
from typing import Any

from websockets.asyncio.client import connect

from panoptic_ros.view.page.packets import HEAD, MESSAGE
from panoptic_ros.view.page.peek import stamp_of_bytes

SLOW_S = 0.02  # s; drawing time per packet of a slow client
WARM_S = 1.5  # s; warm-up time excluded from the measurement


async def _client(address: str, kind: str, seconds: float) -> dict[str, Any]:
    """Run one client for `seconds` after the warm-up and return its row."""
    came: list[tuple[int, int]] = []
    size, dropped, until = 0, 0, time.monotonic() + WARM_S + seconds
    async with connect(address, max_size=None, compression=None) as page:
        topics: list[list[str]] = []
        while (left := until - time.monotonic()) > 0:
            if kind == "cut":
                await asyncio.sleep(left)
                break
            try:
                data = await asyncio.wait_for(page.recv(), left)
            except asyncio.TimeoutError:  # asyncio.TimeoutError is not yet TimeoutError in Python 3.10
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
                came.append((stamp, now_ns))
        if kind == "cut":
            page.transport.abort()
    return {"kind": kind, "came": came, "megabytes_per_s": 1e-6 * size / seconds, "skipped": dropped}


def _newest(packet: bytes, topics: list[list[str]]) -> int | None:
    """Return the timestamp (ns) of the newest skeletons in a packet."""
    newest, at = None, HEAD.size
    while at < len(packet):
        topic, length, _ = MESSAGE.unpack_from(packet, at)
        begin = at + MESSAGE.size
        if topics[topic][0] == "skeletons":
            newest = max(newest or 0, stamp_of_bytes(packet[begin : begin + length]))
        at = begin + length + -(MESSAGE.size + length) % 8
    return newest


def data_address(address: str) -> str:
    """Return the WebSocket address of a page's data, with the page's token."""
    page, _, query = address.partition("?")
    return page.replace("http", "ws", 1) + "data" + (f"?{query}" if query else "")


async def look_on(address: str, seconds: float, kinds: list[str]) -> list[dict[str, Any]]:
    """Run all clients at the same time and return their rows."""
    data = data_address(address)
    return list(await asyncio.gather(*(_client(data, kind, seconds) for kind in kinds)))


if __name__ == "__main__":
    print(json.dumps(asyncio.run(look_on(sys.argv[1], float(sys.argv[2]), sys.argv[3:]))))
