"""Errors of bodies as a table: mean, median, standard deviation and MAD of each kind (Malleson et al. 2020,
4.1 and Table 1)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

Rows = Sequence[Mapping[str, Any]]
STATISTICS = {"mean": "", "med": "_median", "std": "_std", "MAD": "_mad"}


class Kinds(NamedTuple):
    """Kinds of errors that stand in one table, by their keys in the rows, and the unit."""

    title: str
    keys: Mapping[str, str]


POSITIONS = Kinds(
    "joints, mm",
    {
        "global": "mm",
        "from the root": "relative_mm",
        "Procrustes": "procrustes_mm",
        "less constant offsets": "aligned_mm",
    },
)
ORIENTATIONS = Kinds(
    "segments, deg",
    {
        "global": "deg",
        "Procrustes": "procrustes_deg",
        "less constant turns": "aligned_deg",
        "to the parent": "joint_deg",
        "joint angles": "angle_deg",
    },
)


def statistic_lines(kinds: Kinds, groups: Mapping[str, Rows], label: str) -> Iterator[str]:
    """The table: two lines of head, and one for each group of rows, means over its rows.

    Args:
        groups: by the words of at most 26 letters at the beginning of the line.
        label: over these words.
    """
    yield f"{kinds.title:<26}" + "".join(f"  {name:^23}" for name in kinds.keys)
    names = "".join(f"{name:>6}" for name in STATISTICS)
    yield f"{label:<26}" + "".join(f" {names}" for _ in kinds.keys)
    for name, rows in groups.items():
        yield f"{name:<26}" + "".join(" " + _numbers(rows, key) for key in kinds.keys.values())


def _numbers(rows: Rows, key: str) -> str:
    means = [np.mean([row.get(key + ending, np.nan) for row in rows]) for ending in STATISTICS.values()]
    return "".join(f"{mean:6.{int(mean < 1000.0)}f}" if np.isfinite(mean) else f"{'-':>6}" for mean in means)
