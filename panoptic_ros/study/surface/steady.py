"""The study `steady`: the value of surface motion on captures without ground truth."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from panoptic_ros.capture import demo_capture
from panoptic_ros.domain import RefinedPoseSet
from panoptic_ros.evaluation import SkeletonSequence
from panoptic_ros.evaluation.capture_report import limb_bones
from panoptic_ros.evaluation.steadiness import FEWEST, slow_motion, steadiness
from panoptic_ros.graph.build import merged
from panoptic_ros.running.plans.options import RunOptions
from panoptic_ros.running.plans.parameters import read_parameters
from panoptic_ros.running.plans.planning import plan_capture
from panoptic_ros.stage import Progress
from panoptic_ros.study.options import add_capture, add_settings
from panoptic_ros.study.study import Case, Column, Row, Study
from panoptic_ros.study.surface.refine_ways import RefinementInputs, played_on, smoothed

Array = np.ndarray
DEMOS = {"demo": "multi", "demo-single": "single"}
LAGS = (0.0, 0.12)  # s, of the smoother
STEADIEST = 1.0  # s, lag of the tracks whose low-pass filtered motion is the reference


class SteadinessStudy(Study):
    """Figures of everybody without and with patches, in a capture without truth.

    Each person has one row per lag and method: length variation of limbs, acceleration and its noise.
    """

    columns = (
        Column("person", "person"),
        Column("lag_s", "lag s", ".2f"),
        Column("method", "method"),
        Column("instants", "instants"),
        Column("acceleration", "acc m/s2", ".2f"),
        Column("noise", "noise m/s2", ".2f"),
        Column("noise_change", "change", "+.0%"),
        Column("limb_median_cm", "limbs cm, median", ".2f"),
        Column("limb_median_cm_change", "change", "+.0%"),
        Column("limb_worst_cm", "worst", ".2f"),
    )

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        add_capture(parser, 'capture folder; "demo" and "demo-single": the demo captures')
        add_settings(parser)

    def measure(self, case: Case, progress: Progress) -> list[Row]:
        """See `Study`."""
        given = self.options
        name, settings = DEMOS.get(str(given.capture)), read_parameters(None, given.settings)
        options = RunOptions(merged({"patches": {"active": True}}, settings))
        place = given.capture if name is None else demo_capture(name)
        plan = plan_capture(place, options, cameras=given.cameras or None, depth=False)
        played, _ = played_on(plan, plan.rig, SkeletonSequence(plan.skeleton.joint_names, ()), progress)
        progress(0.9, "smoothing")
        return with_changes(steady_rows(played))


def with_changes(rows: list[Row]) -> list[Row]:
    """Add the relative change against the row without patches of the same person and lag."""
    found: list[Row] = []
    before: Row = {}
    for row in rows:
        if (before.get("person"), before.get("lag_s")) == (row["person"], row["lag_s"]):
            keys = [key for key in ("noise", "limb_median_cm") if before[key]]
            row = row | {f"{key}_change": row[key] / before[key] - 1.0 for key in keys}
        found.append(row)
        before = row
    return found


def steady_rows(played: RefinementInputs) -> list[dict[str, Any]]:
    """Return a row per person, lag and method, for persons with at least `FEWEST` time steps."""
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
    """Return timestamps (F,) ns and joints (F, J, 3) m of each person, first to last set; NaN = missing."""
    found: dict[int, tuple[Array, Array]] = {}
    for person in sorted({int(number) for item in items for number in item.ids}):
        there = [k for k, item in enumerate(items) if person in item.ids]
        span = items[there[0] : there[-1] + 1]
        nothing = np.full(items[0].positions.shape[1:], np.nan)
        places = [item.positions[item.ids == person] for item in span]
        joints = np.array([place[0] if len(place) else nothing for place in places])
        found[person] = np.array([item.stamp_ns for item in span]), joints
    return found
