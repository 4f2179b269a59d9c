"""Table of the leave-one-person-out benefit of a joint bias table."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from panoptic_ros.evaluation.bias import Benefit


def bias_table(benefits: Sequence[Benefit]) -> str:
    """Return a text table of each person's error and PCK, before and after bias removal.

    The removed biases were measured on all other people (leave one out).
    """
    lines = ["person, measured on the others    median mm   after    PCK 5 cm   after"]
    for b in benefits:
        lines.append(_row(str(b.person), b.median_before, b.median_after, b.pck_before, b.pck_after))
    names = ("median_before", "median_after", "pck_before", "pck_after")
    means = [float(np.mean([getattr(b, name) for b in benefits])) for name in names]
    lines.append(_row("mean of the people", *means))
    return "\n".join(lines)


def _row(name: str, *values: float) -> str:
    return "{:<32}{:>11.1f}{:>8.1f}{:>12.3f}{:>8.3f}".format(name, *values)
