"""Clients of a live page without a page: what they get when, whatever they do with it.

`python -m panoptic_ros.view.page.clients ADDRESS SECONDS KIND ...` prints JSON, a row for each client: "came"
holds of every packet the stamp of its newest skeletons and when it came or was drawn, ns. Kinds:
fast draws at once, slow takes 20 ms for each packet, frozen never draws, cut does not even read.
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

SLOW_S = 0.02  # for one packet
WARM_S = 1.5  # that do not count


async def _client(address: str, kind: str, seconds: float) -> dict[str, Any]:
    """Look on for so long."""
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
                came.append((stamp, now_ns))
        if kind == "cut":
            page.transport.abort()
    return {"kind": kind, "came": came, "megabytes_per_s": 1e-6 * size / seconds, "skipped": dropped}


def _newest(packet: bytes, topics: list[list[str]]) -> int | None:
    """The stamp of the newest skeletons in a packet, ns."""
    newest, at = None, HEAD.size
    while at < len(packet):
        topic, length, _ = MESSAGE.unpack_from(packet, at)
        begin = at + MESSAGE.size
        if topics[topic][0] == "skeletons":
            newest = max(newest or 0, stamp_of_bytes(packet[begin : begin + length]))
        at = begin + length + -(MESSAGE.size + length) % 8
    return newest


def data_address(address: str) -> str:
    """Return the address of the data of a page, whose token it keeps."""
    page, _, query = address.partition("?")
    return page.replace("http", "ws", 1) + "data" + (f"?{query}" if query else "")


async def look_on(address: str, seconds: float, kinds: list[str]) -> list[dict[str, Any]]:
    """All of them at once."""
    data = data_address(address)
    return list(await asyncio.gather(*(_client(data, kind, seconds) for kind in kinds)))


if __name__ == "__main__":
    print(json.dumps(asyncio.run(look_on(sys.argv[1], float(sys.argv[2]), sys.argv[3:]))))
