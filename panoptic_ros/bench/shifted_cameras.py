"""Clocks from motion on a recording: two cameras are shifted by known amounts, to be found again."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from panoptic_ros.domain import DetectionSet, Rig, ViewDetections
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.clocks_from_motion import find_clocks
from panoptic_ros.io.recorded_people import read_people
from panoptic_ros.io.rigs import read_rig
from panoptic_ros.stage import StageContext

Array = np.ndarray
FRAMES = (0.0, 0.5, 1.0, 2.0, 4.0)  # how far cameras are shifted
REACH = 4  # frames on either side that shifted views may move to


def measure_shifts(args: argparse.Namespace) -> dict[str, Any]:
    """Offsets of the recording as it is, and of shifted ones less what was put in and those as it is, s."""
    rig = read_rig(args.rig)
    people = read_people(args.detections, rig)
    sets, context, configs = people.sets, StageContext(rig, people.skeleton), configure({})
    period = int(np.median(np.diff([item.stamp_ns for item in sets])))
    rows: list[dict[str, Any]] = []
    for k, frames in enumerate(FRAMES):
        shifts = np.zeros(len(rig))
        if frames:
            first = (k - 1) % len(rig)
            shifts[[first, (first + 2) % len(rig)]] = frames, frames if k % 2 else -frames
        clocks = find_clocks(shifted(sets, rig, shifts, period), context, configs).clocks
        late = clocks.offsets + 1e-9 * period * shifts
        rows.append(
            {
                "frames": shifts.tolist(),
                "offsets_s": clocks.offsets.tolist(),
                "stated_s": clocks.deviations.tolist(),
                "corrected": clocks.applied.tolist(),
                "late_s": (late - late.mean()).tolist(),
            }
        )
    for row in rows:
        row["from_unshifted_s"] = (np.array(row["late_s"]) - rows[0]["late_s"]).tolist()
    return {"cameras": list(rig.names), "period_s": 1e-9 * period, "shifts": rows}


def shift_lines(result: dict[str, Any]) -> list[str]:
    """The table."""
    rows = [f"cameras {', '.join(result['cameras'])}; one frame is {1e3 * result['period_s']:.1f} ms; in ms:"]
    for row in result["shifts"]:
        shift = ", ".join(f"{frames:+g}" for frames in row["frames"])
        rows.append(f"shifted by {shift} frames")
        rows.append("  found          " + _numbers(row["offsets_s"], 1))
        rows.append("  stated         " + _numbers(row["stated_s"], 1))
        rows.append("  from unshifted " + _numbers(row["from_unshifted_s"], 2))
    return rows


def shifted(sets: Sequence[DetectionSet], rig: Rig, shifts: Array, period: int) -> list[DetectionSet]:
    """The sets with cameras' stamps moved by so many frames (C,), and each view in the set nearest to it."""
    given = [item.stamp_ns for item in sets]
    instants = np.array(sorted({t + k * period for t in given for k in range(-REACH, REACH + 1)}), np.int64)
    places: list[dict[str, ViewDetections]] = [{} for _ in instants]
    for item in sets:
        for view in item.views:
            stamp = view.stamp_ns + round(period * float(shifts[rig.index(view.camera)]))
            near = int(np.abs(instants - stamp).argmin())
            places[near].setdefault(view.camera, replace(view, stamp_ns=max(0, stamp)))
    return [
        DetectionSet(i, int(t), sets[0].skeleton_hash, tuple(p[n] for n in rig.names if n in p))
        for i, (t, p) in enumerate(zip(instants, places))
        if t >= 0
    ]


def _numbers(values: Sequence[float], digits: int) -> str:
    return "  ".join(f"{1e3 * value:+8.{digits}f}" for value in values)
