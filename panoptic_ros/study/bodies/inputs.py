"""The study `kinematics-inputs`: errors by numbers of cameras and IMUs, compared with the paper's solver.

The study repeats Fig. 7 of Malleson et al. 2020.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from panoptic_ros.io.files import write_bytes
from panoptic_ros.running.kinematics import PAPER
from panoptic_ros.stage import Progress, each
from panoptic_ros.study.bodies.cases import METHODS, OURS, BodyStudy
from panoptic_ros.study.bodies.statistics import ORIENTATIONS, POSITIONS, statistic_lines
from panoptic_ros.study.options import numbers
from panoptic_ros.study.study import Case, Result, Row, grouped

CAMERAS, IMUS = (0, 1, 2, 4, 8), (0, 6, 13)


class Inputs(BodyStudy):
    """Errors by cameras, IMUs and method, on each capture."""

    has_plot = True

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        super().add_options(parser)
        parser.add_argument(
            "--cameras",
            type=numbers(0, 64),
            default=CAMERAS,
            metavar="N,N",
            help=f"numbers of cameras; default {','.join(map(str, CAMERAS))}",
        )

    def measure(self, case: Case, progress: Progress) -> Iterator[Row]:
        """See `Study`."""
        capture, configs = self.capture(case), self.configs
        kinds = [(c, i) for c in self.options.cameras for i in IMUS if c or i]
        for count, imus in each(kinds, len(kinds), progress, "cameras and IMUs"):
            part = capture.with_inputs(count, imus)
            kind = {"scene": capture.name, "seed": capture.seed, "cameras": count, "imus": imus}
            for method in METHODS:
                yield kind | {"method": method} | part.score(configs[method])

    def lines(self, result: Result) -> Iterator[str]:
        """Yield tables of positions and orientations, and the worst ratio of our error to the paper's."""
        yield f"{self.head(result)}; means over the captures"
        groups = grouped(result["rows"], lambda row: f"{row['cameras']} + {row['imus']:<2} {row['method']}")
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

    def plot(self, path: Path, result: Result) -> None:
        """See `Study`."""
        # imported here because matplotlib is slow to load
        from panoptic_ros.view.body_study_plot import body_study_plot

        write_bytes(path, body_study_plot(result["rows"], OURS, self.head(result)))
