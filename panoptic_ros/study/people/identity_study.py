"""The study `identity`: people who are hidden, cross, come and go, and whom few views see."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from typing import Any

from panoptic_ros.running.plans.parameters import read_parameters
from panoptic_ros.stage import Progress
from panoptic_ros.study.options import add_seeds, add_settings, within
from panoptic_ros.study.people.designated import designated
from panoptic_ros.study.people.dressed import dressed_visits
from panoptic_ros.study.people.identity import VISITS_S, few_views, trials, visits
from panoptic_ros.study.study import Case, Result, Row, Study

TRIALS_PER_TAKE = 10  # of the other scenes, which are longer
DESIGNATED_S = 60.0  # of a take with a designated person; half as many as of the others
PARTS = {"trials": 4.0, "few views": 2.0, "visits": 1.0, "designated": 1.0, "dressed": 2.0}  # costs


class Identity(Study):
    """Trials of each kind; a tenth of it of few views; 6 s of visits for each trial, 3 s of other visits."""

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        parser.add_argument(
            "--trials",
            type=within(int, 1, 10**6),
            default=100,
            metavar="N",
            help="of each kind, with seeds from the first on; default 100",
        )
        add_seeds(parser, "0")
        add_settings(parser)

    def cases(self) -> list[Case]:
        """See `Study`."""
        return [Case(part, part, cost) for part, cost in PARTS.items()]

    def measure(self, case: Case, progress: Progress) -> list[Row]:
        """See `Study`."""
        count, seed = self.options.trials, self.options.seeds.start
        settings, takes = read_parameters(None, self.options.settings), max(1, count // TRIALS_PER_TAKE)
        parts: dict[str, Callable[[], dict[str, Any]]] = {
            "trials": lambda: trials(count, seed, settings, progress),
            "few views": lambda: few_views(takes, seed, settings, progress),
            "visits": lambda: visits(seed, settings, VISITS_S * count / 100),
            "designated": lambda: designated(max(1, takes // 2), seed, settings, DESIGNATED_S, progress),
            "dressed": lambda: dressed_visits(seed, VISITS_S * count / 200, settings),
        }
        return [{"part": case.request} | parts[case.request]()]

    def lines(self, result: Result) -> Iterator[str]:
        """See `Study`."""
        parts = {row["part"]: row for row in result["rows"]}
        for kind, share in parts["trials"]["kept"].items():
            yield f"{kind:20} ids kept in {share:.1%} of {parts['trials']['trials']} takes"
        few = parts["few views"]
        for name, row in few["phases"].items():
            yield (
                f"{name:20} error {row['mean_mm']:.1f} mm (95 %: {row['p95_mm']:.1f}), "
                f"{row['joints_given']:.0%} of the joints given, {row['in_ellipsoid']:.1%} in the ellipsoid "
                "that should hold 95 %"
            )
        child = few["child"]
        yield (
            f"child among adults   lost for {child['lost_s']:.2f} s (at most {child['most_lost_s']:.2f}), "
            f"id kept in {child['kept']:.0%} of {few['takes']} takes"
        )
        rows = {"come and go": parts["visits"]}
        rows |= {f"dressed, {name}": parts["dressed"][name] for name in ("bones", "appearance")}
        for name, row in rows.items():
            yield (
                f"{name:20} {row['changes']} ids changed while there; {row['same']} of {row['returns']} "
                f"returned under their own, {row['foreign']} under somebody else's"
            )
        own = parts["designated"]
        yield (
            f"a designated person  followed in {own['followed'] / max(own['there'], 1):.1%} of the instants "
            f"that show the person; a bystander had the id in {own['taken']}"
        )
