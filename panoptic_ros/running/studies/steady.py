"""`panoptic evaluate --study steady`: what the motion of the surface is worth where there is no truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.capture import demo_capture
from panoptic_ros.domain import RefinedPoseSet
from panoptic_ros.evaluation import SkeletonSequence
from panoptic_ros.evaluation.capture_report import limb_bones
from panoptic_ros.evaluation.steadiness import FEWEST, slow_motion, steadiness
from panoptic_ros.graph.build import merged
from panoptic_ros.running.plans.options import RunOptions
from panoptic_ros.running.plans.parameters import Parameters
from panoptic_ros.running.plans.planning import plan_capture
from panoptic_ros.running.studies.refine_ways import Played, played_on, smoothed
from panoptic_ros.stage import Progress

Array = np.ndarray
DEMOS = {"demo": "multi", "demo-single": "single"}
LAGS = (0.0, 0.12)  # s
STEADIEST = 1.0  # s, lag of the motion that slow motion is taken of


def study_steadiness(
    folder: Path, cameras: Sequence[str], settings: Parameters, progress: Progress
) -> dict[str, Any]:
    """Figures of everybody without and with patches, for JSON.

    Args:
        folder: a capture folder; "demo" and "demo-single": the demo captures. cameras: only these.
        settings: {stage: {parameter: value}}, for all methods.

    Raises:
        UsageError: if it is no capture.
    """
    name = DEMOS.get(str(folder))
    options = RunOptions(merged({"patches": {"active": True}}, settings))
    place = folder if name is None else demo_capture(name)
    plan = plan_capture(place, options, cameras=list(cameras) or None, depth=False)
    played, _ = played_on(plan, plan.rig, SkeletonSequence(plan.skeleton.joint_names, ()), progress)
    progress(0.9, "smoothing")
    used = list(plan.rig.names)
    result = {"study": "steady", "capture": str(folder), "cameras": used, "rows": steady_rows(played)}
    progress(1.0, "scoring")
    return result


def steady_rows(played: Played) -> list[dict[str, Any]]:
    """A row for each person, lag and method; who is there for fewer than `FEWEST` instants has none."""
    patches = played.patches()
    reference = tracks_of(smoothed(played, STEADIEST, patches))
    limbs = np.array([played.skeleton.bones[b] for b in limb_bones(played.skeleton)]).reshape(-1, 2)
    slow = {person: slow_motion(*track) for person, track in reference.items() if len(track[0]) >= FEWEST}
    rows = []
    for lag in LAGS:
        for method, found in (("smoother", ()), ("smoother, patches", patches)):
            tracks = tracks_of(smoothed(played, lag, found))
            for person, own in slow.items():
                if person in tracks and len(tracks[person][0]) >= FEWEST:
                    told = steadiness(*tracks[person], own, limbs)
                    rows.append({"person": person, "lag_s": lag, "method": method, **asdict(told)})
    return sorted(rows, key=lambda row: (row["person"], row["lag_s"]))


def tracks_of(items: Sequence[RefinedPoseSet]) -> dict[int, tuple[Array, Array]]:
    """Stamps (F,) ns and joints (F, J, 3) m of everybody, from first to last instant; NaN = missing."""
    found: dict[int, tuple[Array, Array]] = {}
    for person in sorted({int(number) for item in items for number in item.ids}):
        there = [k for k, item in enumerate(items) if person in item.ids]
        span = items[there[0] : there[-1] + 1]
        nothing = np.full(items[0].positions.shape[1:], np.nan)
        places = [item.positions[item.ids == person] for item in span]
        joints = np.array([place[0] if len(place) else nothing for place in places])
        found[person] = np.array([item.stamp_ns for item in span]), joints
    return found


def steady_lines(result: Mapping[str, Any]) -> list[str]:
    """The figures as a table; changes are against the row without patches."""
    lines = [
        f"steadiness of {result['capture']}, {len(result['cameras'])} cameras",
        f"{'person':>6} {'lag s':>6} {'method':18} {'instants':>8} {'acc m/s2':>9} {'noise m/s2':>18} "
        f"{'limbs cm, median':>18} {'worst':>6}",
    ]
    before: Mapping[str, Any] = {}
    for row in result["rows"]:
        same = (before.get("person"), before.get("lag_s")) == (row["person"], row["lag_s"])
        noise, limb = (
            f"{row[name]:.2f} ({row[name] / before[name] - 1.0:+4.0%})"
            if same and before[name]
            else f"{row[name]:.2f}        "
            for name in ("noise", "limb_median_cm")
        )
        lines.append(
            f"{row['person']:>6} {row['lag_s']:6.2f} {row['method']:18} {row['instants']:>8} "
            f"{row['acceleration']:9.2f} {noise:>18} {limb:>18} {row['limb_worst_cm']:6.2f}"
        )
        before = row
    return lines
