"""The studies `view` and `view-recording`: cost of viewers, and age of the displayed data.

`view-recording` measures the time to open a recording and to seek in it, without a browser.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from websockets.asyncio.client import connect

from panoptic_ros.running.arguments import within
from panoptic_ros.running.viewer.process import viewer
from panoptic_ros.stage import Progress
from panoptic_ros.study.live.view_feed import PEOPLE, RATE_HZ, VIEWS, view_load
from panoptic_ros.study.live.view_figures import NOBODY, table_of
from panoptic_ros.study.study import Case, Column, Result, Row, Study, table
from panoptic_ros.view.page.clients import data_address
from panoptic_ros.view.page.recorded import BLOCK_NS

AUDIENCES: dict[str, tuple[str, ...]] = {
    "one": ("fast",),
    "slow": ("fast", "slow"),
    "frozen, cut": ("fast", "frozen", "cut"),
    "ten": ("fast",) * 10,
}
CLIENTS = (
    Column("client", "client"),
    Column("packets", "packets"),
    Column("age_p50_ms", "age p50 ms", ".1f"),
    Column("age_p99_ms", "p99 ms", ".1f"),
    Column("age_max_ms", "most", ".0f"),
    Column("megabytes_per_s", "MB/s", ".2f"),
    Column("skipped", "skipped"),
)
SEEKS = 40


def open_and_seek(path: Path, seed: int = 0) -> dict[str, Any]:
    """Open a recording, load the page and the first second of data, then random seconds.

    Returns:
        seconds from the command to the address, and to the first second of data; seek times (ms); length (s).

    Raises:
        EnvironmentProblem: if the viewer does not start.
    """
    begun = time.perf_counter()
    with viewer([str(path)]) as (_, address):
        told = time.perf_counter() - begun
        urllib.request.urlopen(address).read()
        return {"address_s": told, **asyncio.run(_seek(address, begun, np.random.default_rng(seed)))}


async def _seek(address: str, begun: float, rng: np.random.Generator) -> dict[str, Any]:
    async with connect(data_address(address), max_size=None, compression=None) as page:

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


class View(Study):
    """A load is played before audiences in turn, each round in another order, with nobody between them.

    An audience is a set of viewer clients. A phase without clients precedes each of them and is the baseline.
    """

    columns = (
        Column("audience", ""),
        Column("messages", "/skeletons", ".0f"),
        Column("lost", "lost", ".0f"),
        Column("skeletons_p50_ms", "p50, ms", ".2f"),
        Column("skeletons_p99_ms", "p99, ms", ".2f"),
        Column("p99_ratio", "p99 / without audience", ".2f"),
        Column("ratio_low", "  95 % from", ".2f"),
        Column("ratio_high", "  to", ".2f"),
        Column("publish_p50_ms", "publish a view p50, ms", ".3f"),
        Column("publish_p99_ms", "  p99", ".3f"),
        Column("viewer_cpu_percent", "viewer, % of a core", ".1f"),
        Column("viewer_mb", "viewer, MB", ".0f"),
    )
    across = True

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        parser.add_argument(
            "--seconds",
            type=within(float, 2.0, 600.0),
            default=8.0,
            metavar="S",
            help="duration for each audience; default 8",
        )
        parser.add_argument(
            "--rounds",
            type=within(int, 1, 100),
            default=3,
            metavar="N",
            help="number of rounds over all audiences, with no audience between two; default 3",
        )

    def measure(self, case: Case, progress: Progress) -> list[Row]:
        """See `Study`."""
        from panoptic_ros.study.live.viewed_graph import run_viewed_graph  # needs ROS

        turns, names = [], list(AUDIENCES)
        for number in range(self.options.rounds):
            for name in names[number % len(names) :] + names[: number % len(names)]:
                turns += [(NOBODY, ()), (name, AUDIENCES[name])]
        progress(0.0, "simulating")
        return table_of(run_viewed_graph(view_load(), self.options.seconds, turns, progress))

    def summary(self, rows: list[Row]) -> dict[str, Any]:
        """See `Study`."""
        return {"cores": os.cpu_count(), "load": os.getloadavg()[0]}

    def head(self, result: Result) -> str:
        """See `Study`."""
        return (
            f"{PEOPLE} people, {VIEWS} cameras at {RATE_HZ:g} Hz, previews at 10 Hz; {self.options.rounds} "
            f"times {self.options.seconds:g} s each; {result['cores']} cores, load {result['load']:.1f}"
        )

    def lines(self, result: Result) -> Iterator[str]:
        """See `Study`."""
        yield from super().lines(result)
        clients = [
            {"client": f"{row['audience']}: {own['kind']}"} | own
            for row in result["rows"]
            for own in row["clients"]
        ]
        yield from ("", *table(clients, CLIENTS))


class ViewRecording(Study):
    """A recording is opened, and seconds of it are looked at here and there.

    The row has the times to open the recording and to seek to random seconds.
    """

    columns = (
        Column("seconds", "s", ".0f"),
        Column("address_s", "to the address, s", ".2f"),
        Column("first_s", "to the first second of data, s", ".2f"),
        Column("seeks", "seeks"),
        Column("seek_p50_ms", "p50, ms", ".0f"),
        Column("seek_p99_ms", "p99, ms", ".0f"),
        Column("seek_max_ms", "most, ms", ".0f"),
    )

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        parser.add_argument(
            "--recording", type=Path, metavar="RESULTS|BAG", required=True, help="recording to open"
        )

    def measure(self, case: Case, progress: Progress) -> list[Row]:
        """See `Study`."""
        return [{"load": os.getloadavg()[0]} | open_and_seek(self.options.recording)]
