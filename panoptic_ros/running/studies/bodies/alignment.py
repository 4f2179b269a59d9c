"""Heading and clock of IMUs found from a few seconds of motion, both injected; and lengths of bodies."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from panoptic_ros.domain.subjects import ImuSeries
from panoptic_ros.kinematics.imus.alignment import Felt, align, cameras_alone, felt_of
from panoptic_ros.running.kinematics import body_config
from panoptic_ros.running.studies.bodies.cases import SKIPPED_S, BodyCase
from panoptic_ros.running.studies.bodies.learnt_lengths import lengths_lines, lengths_row
from panoptic_ros.simulation.bodies.imus import unknown_heading
from panoptic_ros.stage import Progress

Array = np.ndarray
INPUTS = ((8, 13), (4, 6))  # cameras, IMUs
WINDOWS_S = (5.0, 9.0)
LONGEST_OFFSET_S = 0.1
RATE_HZ = 60.0


def study_alignment(
    cases: Iterable[BodyCase], number: int, settings: Sequence[str], progress: Progress
) -> dict[str, Any]:
    """A row for each stretch of motion, half of which overlaps with the next: errors, deg and ms; and a row
    for each capture: errors with lengths that motion tells.

    Args:
        settings: NAME=VALUE of the kinematics.
    """
    whole = body_config(settings=settings)
    config = cameras_alone(whole)
    rows, lengths = [], []
    for n, case in enumerate(cases):
        for k, (cameras, imus) in enumerate(INPUTS):
            progress((n + k / len(INPUTS)) / number, f"{case.name}, {cameras} cameras, {imus} IMUs")
            part = case.with_inputs(cameras, imus)
            bare = tuple(replace(subject, devices=()) for subject in part.subjects)
            seen = replace(part, subjects=bare, recording=replace(part.recording, devices={}))
            states = seen.solve(config).states
            kind = {"scene": case.name, "seed": case.seed, "cameras": cameras, "imus": imus}
            learnt = lengths_row(part, whole)
            lengths += [] if learnt is None else [kind | learnt]
            rng = np.random.default_rng([case.seed, 5])
            for length in WINDOWS_S:
                begin = states[0].stamp_ns + round(1e9 * SKIPPED_S)
                while begin + round(1e9 * length) <= states[-1].stamp_ns:
                    stretch = [s for s in states if begin <= s.stamp_ns <= begin + round(1e9 * length)]
                    rows.append(kind | {"seconds": length} | _found(part, stretch, rng))
                    begin += round(5e8 * length)
    return {"study": "alignment", "rows": rows, "lengths": lengths}


def _found(case: BodyCase, states: list[Any], rng: np.random.Generator) -> dict[str, Any]:
    """What is found of a heading and an offset that are drawn."""
    heading, late = rng.uniform(-np.pi, np.pi), rng.uniform(-LONGEST_OFFSET_S, LONGEST_OFFSET_S)
    subject = replace(case.subjects[0], heading_known=False)
    felt = {}
    for device in subject.devices:
        series = unknown_heading(case.recording.devices[device.name], heading).shifted(round(1e9 * late))
        felt[device.name] = _during(series, states)
    found = align(subject, states, felt)
    if found is None:
        return {"found": False, "deg": float("nan"), "ms": float("nan")}
    off = (found.heading - heading + np.pi) % (2.0 * np.pi) - np.pi
    return {
        "found": True,
        "deg": float(np.degrees(off)),
        "ms": 1e3 * (found.offset + late),
        "unsure_deg": float(np.degrees(found.heading_unsure)),
        "unsure_ms": 1e3 * found.unsure,
    }


def _during(series: ImuSeries, states: list[Any]) -> Felt:
    """What was felt in the time of these bodies."""
    there = (series.stamps >= states[0].stamp_ns) & (series.stamps <= states[-1].stamp_ns)
    parts = (series.stamps, series.quaternions, series.rates, series.forces)
    return felt_of(ImuSeries(*(part[there] for part in parts)), RATE_HZ)


def alignment_lines(result: dict[str, Any]) -> Iterator[str]:
    """The table: root mean square (most) over all stretches in which motion tells."""
    yield "simulated captures; heading and clock from stretches of motion, root mean square (most)"
    yield ("cameras IMUs  seconds  stretches   found     heading, deg         clock, ms   both, in their sd")
    rows = result["rows"]
    for kind in dict.fromkeys((row["cameras"], row["imus"], row["seconds"]) for row in rows):
        mine = [row for row in rows if (row["cameras"], row["imus"], row["seconds"]) == kind]
        found = [row for row in mine if row["found"]]
        cells = [_cell([row[key] for row in found]) for key in ("deg", "ms")]
        ratio = ", ".join(_cell([row[key] / row[f"unsure_{key}"] for row in found]) for key in ("deg", "ms"))
        text = f"{kind[0]:7} {kind[1]:4}  {kind[2]:7g}  {len(mine):9}  {len(found):6}"
        yield f"{text}  {cells[0]:>15}   {cells[1]:>15}   {ratio}"
    yield from lengths_lines(result["lengths"])


def _cell(values: Sequence[float]) -> str:
    if not len(values):
        return "-"
    return f"{np.sqrt(np.mean(np.square(values))):.2f} ({np.abs(values).max():.1f})"
