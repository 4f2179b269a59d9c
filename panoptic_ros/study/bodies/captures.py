"""Captures in which less is known: headings, clocks, mountings, who of several people is asked for, and where
somebody is who walks out of the cameras."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence

import numpy as np

from panoptic_ros.domain.subjects import BodyState
from panoptic_ros.evaluation.kinematic_scores import inside, score_bodies
from panoptic_ros.running.kinematics import PAPER, body_config
from panoptic_ros.running.simulations.body_scenes import OTHER_BODY_SCENES
from panoptic_ros.stage import Progress, each
from panoptic_ros.study.bodies.cases import METHODS, OURS, SKIPPED_S, BodyStudy
from panoptic_ros.study.bodies.drawn import drawn_case
from panoptic_ros.study.study import Case, Result, Row

SORTED = "malleson-2020, its sorting"


class Captures(BodyStudy):
    """A row for each capture, subject and solver."""

    scenes = tuple(OTHER_BODY_SCENES)

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        super().add_options(parser)
        parser.add_argument("--drawn", action="store_true", help="captures whose setup is drawn by the seed")

    def cases(self) -> list[Case]:
        """See `Study`."""
        return [Case(f"drawn {s}", s) for s in self.options.seeds] if self.options.drawn else super().cases()

    def measure(self, case: Case, progress: Progress) -> Iterator[Row]:
        """See `Study`."""
        capture = drawn_case(case.request) if self.options.drawn else self.capture(case)
        configs = self.configs | {SORTED: body_config(PAPER)}
        everybody: dict[int, list[BodyState]] = {}
        for state in (*capture.truth, *capture.strangers):
            everybody.setdefault(state.stamp_ns, []).append(state)
        for method, config in each(configs.items(), len(configs), progress, "solvers"):
            solved = capture.solve(config)
            for subject in capture.subjects:
                truth, mine = (
                    [s for s in both if s.id == subject.id] for both in (capture.truth, solved.states)
                )
                scores = score_bodies(truth, mine, capture.model.parents, SKIPPED_S)
                yield (
                    {"scene": capture.name, "seed": capture.seed, "subject": subject.id, "method": method}
                    | {key: scores.get(key, float("nan")) for key in ("coverage", "mm", "deg", "acc")}
                    | {"taken": taken(mine, everybody), "inside": inside(mine, truth)}
                )

    def lines(self, result: Result) -> Iterator[str]:
        """The table, a line for each subject: ours, the paper's, and ours as a share of it."""
        yield f"{self.head(result)}; after the first 3 s"
        wide = max([16, *(len(row["scene"]) + 2 for row in result["rows"])])
        yield (
            f"{'capture':<{wide}}{'seed':>6}{'subject':>9}{'there':>7}{'mm':>8}{'deg':>7}{'m/s^2':>7}{'taken':>7}"
            f"{'in 95 %':>9}   paper: mm, deg, taken (with its sorting)   ours / paper: mm, deg"
        )
        methods = (*METHODS, SORTED)
        rows = {method: [row for row in result["rows"] if row["method"] == method] for method in methods}
        for ours, paper, own in zip(rows[OURS], rows[PAPER], rows[SORTED]):
            shares = ", ".join(f"{ours[key] / paper[key]:.2f}" for key in ("mm", "deg"))
            yield (
                f"{ours['scene']:<{wide}}{ours['seed']:>6}{ours['subject']:>9}{ours['coverage']:>7.2f}"
                f"{ours['mm']:>8.1f}{ours['deg']:>7.1f}{ours['acc']:>7.1f}{ours['taken']:>7}"
                f"{ours['inside']:>9.3f}   {paper['mm']:.1f}, {paper['deg']:.1f}, {paper['taken']} "
                f"({own['mm']:.1f}, {own['deg']:.1f}, {own['taken']})   {shares}"
            )
        both = [
            [ours[key] / paper[key] for ours, paper in zip(rows[OURS], rows[PAPER])] for key in ("mm", "deg")
        ]
        parts = [f"{np.nanmedian(shares):.2f} ({np.nanmax(shares):.2f})" for shares in both]
        inside = [row["inside"] for row in rows[OURS]]
        yield (
            f"ours / paper, median (worst): mm {parts[0]}, deg {parts[1]}; "
            f"in 95 %: {np.nanmean(inside):.3f} in the mean"
        )


def taken(found: Sequence[BodyState], everybody: dict[int, list[BodyState]]) -> int:
    """Instants in which a body is nearer to somebody else than to its own subject."""
    count = 0
    for state in found:
        others = everybody.get(state.stamp_ns, ())
        far = {o.id: np.linalg.norm(np.nan_to_num(o.places - state.places)) for o in others}
        count += bool(far) and min(far, key=lambda number: far[number]) != state.id
    return count
