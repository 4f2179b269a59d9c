"""Errors by numbers of cameras and IMUs (Malleson et al. 2020, Fig. 7), beside the paper's solver."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from panoptic_ros.running.kinematics import PAPER, body_config
from panoptic_ros.running.studies.bodies.cases import METHODS, OURS, BodyCase
from panoptic_ros.stage import Progress

CAMERAS, IMUS = (0, 1, 2, 4, 8), (0, 6, 13)
SHOWN = ("mm", "relative_mm", "procrustes_mm", "deg", "aligned_deg", "acc")


def study_inputs(
    cases: Iterable[BodyCase], number: int, cameras: Sequence[int], settings: Sequence[str],
    progress: Progress,
) -> dict[str, Any]:  # fmt: skip
    """Errors by cameras, IMUs and method, on each of so many captures.

    Args:
        settings: NAME=VALUE of the kinematics, for ours.
    """
    configs = {OURS: body_config(settings=settings), PAPER: body_config(PAPER)}
    kinds = [(c, i) for c in cameras for i in IMUS if c or i]
    rows = []
    for n, case in enumerate(cases):
        for k, (count, imus) in enumerate(kinds):
            progress((n + k / len(kinds)) / number, f"{case.name}, {count} cameras, {imus} IMUs")
            part = case.with_inputs(count, imus)
            kind = {"scene": case.name, "seed": case.seed, "cameras": count, "imus": imus}
            rows += [kind | {"method": m} | part.score(configs[m]) for m in METHODS]
    return {"study": "kinematics-inputs", "rows": rows}


def input_lines(result: dict[str, Any]) -> Iterator[str]:
    """The table: mean over the captures, and the worst ratio of ours to the paper's solver on one capture."""
    yield "simulated captures: no reproduction of Total Capture"
    names = "  ".join(key.rjust(13) for key in SHOWN)
    yield f"cameras IMUs  method         {names}  worst mm / deg of the paper's"
    rows = result["rows"]
    for cameras, imus in dict.fromkeys((row["cameras"], row["imus"]) for row in rows):
        mine = [row for row in rows if (row["cameras"], row["imus"]) == (cameras, imus)]
        by = {method: [row for row in mine if row["method"] == method] for method in METHODS}
        where = "mm" if cameras else "relative_mm"
        worst = [max(a[k] / b[k] for a, b in zip(by[OURS], by[PAPER])) for k in (where, "deg")]
        for method in METHODS:
            means = "  ".join(f"{np.mean([row[key] for row in by[method]]):13.1f}" for key in SHOWN)
            ratio = f"  {worst[0]:.2f} / {worst[1]:.2f}" if method == OURS else ""
            yield f"{cameras:7} {imus:4}  {method:<13}  {means}{ratio}"
