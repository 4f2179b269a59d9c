"""The study `kinematics`: errors of our solver and that of Malleson et al. 2020, compared with goals."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from panoptic_ros.running.kinematics import PAPER
from panoptic_ros.stage import Progress, each
from panoptic_ros.study.bodies.cases import METHODS, OURS, BodyCase, BodyStudy
from panoptic_ros.study.bodies.statistics import ORIENTATIONS, POSITIONS, statistic_lines
from panoptic_ros.study.study import Case, Result, Row, grouped

# error relative to the paper's solver on the same capture that also meets a goal
ENOUGH_MM, ENOUGH_DEG = 0.70, 0.65
POOR = "body-t-pose"  # scene with mountings from a T-pose that is 11 deg off on average
WORST_COUNTS = ("standing_drift_m",)
DRIFT_M = 0.3  # m, limit of the drift of the root while a foot stands, without cameras


class Goal(NamedTuple):
    """Inputs, and limits of the mean errors.

    Args:
        most: limits in mm (relative to the root without cameras), deg, m/s^2 and m of drift.
    """

    cameras: int
    imus: int
    most: dict[str, float]
    stature: bool = False  # segment lengths come from the stature alone
    t_pose: bool = False  # mountings come from a poor T-pose, see `POOR`

    @property
    def name(self) -> str:
        """Return the name in the table."""
        more = ", stature" * self.stature + ", T-pose" * self.t_pose
        return f"{self.cameras} + {self.imus}{more}"

    @property
    def place(self) -> str:
        """Return the key of the position error that counts."""
        return "mm" if self.cameras else "relative_mm"

    def fits(self, case: BodyCase) -> bool:
        """Return whether a capture has the inputs."""
        data = case.recording
        enough = self.cameras <= len(data.views) and bool(data.devices or not self.imus)
        return enough and self.t_pose == (case.name == POOR)


GOALS = (
    Goal(8, 13, {"mm": 17.5, "deg": 6.0, "acc": 4.0}),
    Goal(8, 13, {"mm": 33.0, "deg": 7.4}, stature=True),
    Goal(4, 13, {"mm": 22.0}),
    Goal(4, 6, {"mm": 28.5, "deg": 7.6}),
    Goal(2, 13, {"mm": 28.0}),
    Goal(8, 0, {"mm": 24.0}),
    Goal(0, 13, {"relative_mm": 24.0, "deg": 5.8, "standing_drift_m": DRIFT_M}),
    Goal(8, 13, {}, t_pose=True),
    Goal(0, 13, {}, t_pose=True),
)


class Goals(BodyStudy):
    """Errors of both methods on each capture, for the inputs of each goal that it has."""

    def measure(self, case: Case, progress: Progress) -> Iterator[Row]:
        """See `Study`."""
        capture, configs = self.capture(case), self.configs
        for goal in each(GOALS, len(GOALS), progress, "inputs"):
            if not goal.fits(capture):
                continue
            part = (capture.of_stature() if goal.stature else capture).with_inputs(goal.cameras, goal.imus)
            kind = {"scene": capture.name, "seed": capture.seed, "inputs": goal.name}
            for method in METHODS:
                yield kind | {"method": method} | part.score(configs[method])

    def lines(self, result: Result) -> Iterator[str]:
        """Yield the table: mean and worst capture of both methods, their ratio, and missed goals."""
        yield f"{self.head(result)}; mean (worst capture)"
        yield (
            f"{'cameras + IMUs':<16}{'captures':>9}  {'method':<14}{'mm':>15}{'deg':>14}{'m/s^2':>14}"
            f"{'drift m':>14}{'in 95 %':>9}   ours / paper: mm, deg"
        )
        for goal in GOALS:
            rows = {
                m: [r for r in result["rows"] if (r["inputs"], r["method"]) == (goal.name, m)]
                for m in METHODS
            }
            if not rows[OURS]:
                continue
            for method, found in rows.items():
                keys = [goal.place, "deg", "acc", "standing_drift_m"]
                cells = [_cell(found, key, 2 if key.endswith("_m") else 1) for key in keys]
                text = f"{goal.name:<16}{len(found):>9}  {method:<14}{cells[0]:>15}"
                text += "".join(
                    f"{cell:>14}" for cell in (cells[1:] if not goal.cameras else [*cells[1:3], "-"])
                )
                said = float(np.mean([row["inside"] for row in found])) if goal.cameras else np.nan
                text += f"{said:9.3f}" if np.isfinite(said) else f"{'-':>9}"
                yield text + (f"   {_ratios(rows, goal)}" if method == OURS else "")
            yield f"{'':<16}{'':>9}  {_verdict(goal, rows)}"
        groups = grouped(
            result["rows"],
            lambda row: f"{row['inputs']}, {'ours' if row['method'] == OURS else 'paper'}",
        )
        for kinds in (POSITIONS, ORIENTATIONS):
            yield ""
            yield from statistic_lines(kinds, groups, "cameras + IMUs, method")


def _cell(rows: list[dict[str, Any]], key: str, digits: int) -> str:
    values = [row[key] for row in rows]
    return f"{np.mean(values):.{digits}f} ({max(values):.{digits}f})"


def _shares(rows: dict[str, list[dict[str, Any]]], key: str) -> list[float]:
    return [ours[key] / paper[key] for ours, paper in zip(rows[OURS], rows[PAPER])]


def _ratios(rows: dict[str, list[dict[str, Any]]], goal: Goal) -> str:
    shares = [_shares(rows, key) for key in (goal.place, "deg")]
    return ", ".join(f"{np.mean(share):.2f} ({max(share):.2f})" for share in shares)


def _verdict(goal: Goal, rows: dict[str, list[dict[str, Any]]]) -> str:
    """Return the state of each goal as text.

    The means must meet the limit, or a share of the paper's error. For the drift, the worst capture counts.
    """
    said = []
    for key, most in goal.most.items():
        values = [row[key] for row in rows[OURS]]
        mean = max(values) if key in WORST_COUNTS else float(np.mean(values))
        enough = {goal.place: ENOUGH_MM, "deg": ENOUGH_DEG}.get(key, 0.0)
        by_share = float(np.mean(_shares(rows, key))) <= enough if enough else False
        state = "met" if mean <= most else f"met as {enough:.2f} of the paper's" if by_share else "MISSED"
        said.append(f"{key} {mean:.2f} of {most:g} {state}")
    worse = max(max(_shares(rows, key)) for key in (goal.place, "deg"))
    never = "never worse than the paper's" if worse <= 1.0 else f"WORSE than the paper's, {worse:.2f}"
    return f"goals: {'; '.join([*said, never])}"
