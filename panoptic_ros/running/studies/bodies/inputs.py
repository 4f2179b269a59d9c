"""Errors by numbers of cameras and IMUs (Malleson et al. 2020, Fig. 7), beside the paper's solver."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from panoptic_ros.running.kinematics import PAPER, body_config
from panoptic_ros.running.studies.bodies.cases import METHODS, OURS, SAME_PEOPLE, BodyCase
from panoptic_ros.running.studies.bodies.statistics import ORIENTATIONS, POSITIONS, origin, statistic_lines
from panoptic_ros.stage import Progress

CAMERAS, IMUS = (0, 1, 2, 4, 8), (0, 6, 13)


def study_inputs(
    cases: Iterable[BodyCase],
    number: int,
    cameras: Sequence[int],
    settings: Sequence[str],
    progress: Progress,
) -> dict[str, Any]:
    """Errors by cameras, IMUs and method, on each of so many captures.

    Args:
        settings: NAME=VALUE of the kinematics, for ours.
    """
    configs = {OURS: body_config(settings=settings), PAPER: body_config(PAPER, (SAME_PEOPLE,))}
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
    """Tables of positions and orientations, and the worst ratio of ours to the paper's on one capture."""
    yield f"{origin(result)}; means over the captures"
    groups: dict[str, list[dict[str, Any]]] = {}
    for row in result["rows"]:
        groups.setdefault(f"{row['cameras']} + {row['imus']:<2} {row['method']}", []).append(row)
    for kinds in (POSITIONS, ORIENTATIONS):
        yield from statistic_lines(kinds, groups, "cameras + IMUs, method")
    yield "cameras + IMUs    m/s^2 of joints: ours, the paper's    worst capture, ours / paper: mm, deg"
    rows = result["rows"]
    for cameras, imus in dict.fromkeys((row["cameras"], row["imus"]) for row in rows):
        mine = [row for row in rows if (row["cameras"], row["imus"]) == (cameras, imus)]
        by = {method: [row for row in mine if row["method"] == method] for method in METHODS}
        where = "mm" if cameras else "relative_mm"
        worst = [max(a[k] / b[k] for a, b in zip(by[OURS], by[PAPER])) for k in (where, "deg")]
        felt = [np.mean([row["acc"] for row in by[method]]) for method in METHODS]
        name = f"{cameras} + {imus}"
        yield f"{name:<18}{felt[0]:21.1f}, {felt[1]:<14.1f}{worst[0]:26.2f}, {worst[1]:.2f}"
