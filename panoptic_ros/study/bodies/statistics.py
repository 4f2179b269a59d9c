"""Table of body errors: mean, median, standard deviation and MAD (Malleson et al. 2020, 4.1, Table 1)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

Rows = Sequence[Mapping[str, Any]]
STATISTICS = {"mean": "", "med": "_median", "std": "_std", "MAD": "_mad"}


class ErrorTable(NamedTuple):
    """Errors in one table: title with the unit, and their keys in the rows."""

    title: str
    keys: Mapping[str, str]


POSITIONS = ErrorTable(
    "joints, mm",
    {
        "global": "mm",
        "from the root": "relative_mm",
        "Procrustes": "procrustes_mm",
        "less constant offsets": "aligned_mm",
    },
)
ORIENTATIONS = ErrorTable(
    "segments, deg",
    {
        "global": "deg",
        "Procrustes": "procrustes_deg",
        "less constant turns": "aligned_deg",
        "to the parent": "joint_deg",
        "joint angles": "angle_deg",
    },
)


def statistic_lines(kinds: ErrorTable, groups: Mapping[str, Rows], label: str) -> Iterator[str]:
    """Yield the table: two header lines, and one line per group with the means over its rows.

    Args:
        groups: rows by label of the line; a label has at most 26 characters.
        label: header of the labels.
    """
    yield f"{kinds.title:<26}" + "".join(f"  {name:^23}" for name in kinds.keys)
    names = "".join(f"{name:>6}" for name in STATISTICS)
    yield f"{label:<26}" + "".join(f" {names}" for _ in kinds.keys)
    for name, rows in groups.items():
        yield f"{name:<26}" + "".join(" " + _numbers(rows, key) for key in kinds.keys.values())


def _numbers(rows: Rows, key: str) -> str:
    means = [np.mean([row.get(key + ending, np.nan) for row in rows]) for ending in STATISTICS.values()]
    return "".join(f"{mean:6.{int(mean < 1000.0)}f}" if np.isfinite(mean) else f"{'-':>6}" for mean in means)
