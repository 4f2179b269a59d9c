"""Compute the cost of viewers from observations of a live graph, with confidence intervals.

Latencies come in bursts. The intervals therefore come from resampling whole seconds (block bootstrap, Künsch
1989) instead of single messages.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

Array = np.ndarray
NOBODY = "nobody"
RESAMPLED = 1000  # bootstrap samples
SURE = (2.5, 97.5)  # percentiles of the bootstrap samples


@dataclass(frozen=True, eq=False)
class Phase:
    """A period with one audience, which is a set of viewer clients.

    Args:
        audience: name.
        blocks: (ms) time from the last view of a time step to its skeletons, one array per second.
        published: (ms) duration of each publication of a view, including its preview if one is due.
        lost: time steps without skeletons.
        cpu_percent: (% of a core) processor time of the viewer.
        resident_mb: (MB) memory of the viewer at the end.
        clients: figures of each client.
    """

    audience: str
    blocks: Sequence[Array]
    published: Array
    lost: int
    cpu_percent: float
    resident_mb: float
    clients: Sequence[dict[str, Any]]


def table_of(phases: Sequence[Phase], seed: int = 0) -> list[dict[str, Any]]:
    """Return a row for each audience over all of its phases; the row without an audience is first.

    `p99_ratio` is the p99 latency of /skeletons divided by that without an audience. `ratio_low` and
    `ratio_high` are its 95 % interval. The row without an audience has the ratio of its odd to its even
    phases, which shows random variation alone.
    """
    names = dict.fromkeys((NOBODY, *(phase.audience for phase in phases)))
    by_name = {name: [phase for phase in phases if phase.audience == name] for name in names}
    rng, nobody = np.random.default_rng(seed), by_name[NOBODY]
    rows = []
    for name, found in by_name.items():
        pair = (nobody[1::2], nobody[::2]) if name == NOBODY else (found, nobody)
        ratio, low, high = ratio_of_p99(_blocks(pair[0]), _blocks(pair[1]), rng)
        ages, published = np.concatenate(_blocks(found)), np.concatenate([each.published for each in found])
        rows.append(
            {
                "audience": name,
                "messages": len(ages),
                "lost": sum(each.lost for each in found),
                "skeletons_p50_ms": _percentile(ages, 50),
                "skeletons_p99_ms": _percentile(ages, 99),
                "p99_ratio": ratio,
                "ratio_low": low,
                "ratio_high": high,
                "publish_p50_ms": _percentile(published, 50),
                "publish_p99_ms": _percentile(published, 99),
                "viewer_cpu_percent": float(np.mean([each.cpu_percent for each in found])),
                "viewer_mb": max(each.resident_mb for each in found),
                "clients": _clients(found),
            }
        )
    return rows


def ages_of(client: Mapping[str, Any], published: Mapping[int, int]) -> dict[str, Any]:
    """Return the age of the data that a client received.

    Args:
        client: row of `view.page.clients`.
        published: publication time (ns) of skeletons by timestamp.
    """
    ages = [1e-6 * (when - published[stamp]) for stamp, when in client["came"] if stamp in published]
    p50, p99, most = np.percentile(ages, (50, 99, 100)).tolist() if ages else (None, None, None)
    return {
        "kind": client["kind"],
        "packets": len(ages),
        "age_p50_ms": p50,
        "age_p99_ms": p99,
        "age_max_ms": most,
        "megabytes_per_s": client["megabytes_per_s"],
        "skipped": client["skipped"],
    }


def ratio_of_p99(
    blocks: Sequence[Array], others: Sequence[Array], rng: np.random.Generator
) -> tuple[float, float, float]:
    """Return the ratio of two p99 values and its 95 % interval, by resampling blocks.

    Returns:
        p99 of `blocks` divided by that of `others`, and both ends of the interval; NaN without blocks.
    """
    if not blocks or not others:
        return (float("nan"),) * 3
    ratio = _percentile(np.concatenate(blocks), 99) / _percentile(np.concatenate(others), 99)
    found = []
    for _ in range(RESAMPLED):
        above, below = (
            np.concatenate([group[i] for i in rng.integers(0, len(group), len(group))])
            for group in (blocks, others)
        )
        found.append(_percentile(above, 99) / _percentile(below, 99))
    low, high = np.percentile(found, SURE).tolist()
    return ratio, low, high


def _blocks(phases: Sequence[Phase]) -> list[Array]:
    return [block for phase in phases for block in phase.blocks if len(block)]


def _percentile(values: Array, percent: float) -> float:
    return float(np.percentile(values, percent))


def _clients(phases: Sequence[Phase]) -> list[dict[str, Any]]:
    """Return, per kind of client, the sum of packets and the worst of each other figure.

    It includes all clients of this kind in all phases.
    """
    rows: dict[str, list[dict[str, Any]]] = {}
    for phase in phases:
        for client in phase.clients:
            if client["packets"]:
                rows.setdefault(client["kind"], []).append(client)
    return [
        {
            "kind": kind,
            **{
                key: (sum if key == "packets" else max)(row[key] for row in found)
                for key in found[0]
                if key != "kind"
            },
        }
        for kind, found in rows.items()
    ]
