"""From what a live graph saw while people looked on to numbers: what an audience costs, and how sure that is.

Latencies come in bursts, so chance is told by resampling whole seconds (a block bootstrap, Künsch 1989), not
single messages.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

Array = np.ndarray
NOBODY = "nobody"
RESAMPLED = 1000
SURE = (2.5, 97.5)  # percentiles of what is resampled


@dataclass(frozen=True, eq=False)
class Phase:
    """A while before one audience.

    Args:
        audience: its name.
        blocks: ms from the last view of an instant to its skeletons, an array for each second.
        published: ms that each publication of a view took, with its preview where one is wanted.
        lost: instants without skeletons.
        cpu_percent: of a core, of the viewer. resident_mb: of the viewer, at the end.
        clients: what each page got.
    """

    audience: str
    blocks: Sequence[Array]
    published: Array
    lost: int
    cpu_percent: float
    resident_mb: float
    clients: Sequence[dict[str, Any]]


def table_of(phases: Sequence[Phase], seed: int = 0) -> list[dict[str, Any]]:
    """A row for each audience over all of its phases, nobody first.

    `p99_ratio` is the p99 of /skeletons over that before nobody, `ratio_low` and `ratio_high` its interval of
    95 %. The row of nobody holds the ratio of its odd phases to its even ones: what chance does alone.
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
    """How old what a client got was.

    Args:
        client: a row of `view.page.clients`. published: when skeletons were published by stamp, ns.
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
    """p99 of all values in blocks over that of others, and its interval of 95 % by resampling blocks; NaN
    where there are none."""
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
    """For each kind of page, in each figure the worst of all its pages in all phases; packets in all."""
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
