"""The studies `cameras` and `nodes`: the same persons seen by decreasing numbers of cameras of a rig.

2D poses come from a simulated detector. Cameras are ordered so that each is the farthest from all before it.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from panoptic_ros.domain import Rig
from panoptic_ros.errors import UsageError
from panoptic_ros.graph.build import merged
from panoptic_ros.io.rigs import read_rig
from panoptic_ros.running.arguments import within
from panoptic_ros.running.plans.parameters import read_parameters
from panoptic_ros.running.plans.presets import NO_PRESET, read_preset
from panoptic_ros.simulation import SKELETON, farthest_first, simulate
from panoptic_ros.simulation.studio import relative_noise, study_scene
from panoptic_ros.stage import Progress
from panoptic_ros.study.options import add_seeds, add_settings, numbers
from panoptic_ros.study.rigs.score import THRESHOLDS
from panoptic_ros.study.rigs.solving import Method, score, solve
from panoptic_ros.study.study import Case, Column, Result, Row, Study, grouped, shared_out
from panoptic_ros.study.world import truth_of

AREA = 1.6  # m, radius of the area in which persons move
PAPER, NOTHING = "panoptic-studio", "none"
MODEL = "movenet-multipose"
PCK = (0.01, 0.02, 0.05)  # m, distance thresholds in the table


class RigStudy(Study):
    """Base of the studies of a rig: simulated people, the default and a preset beside it.

    Attributes:
        people: default of the option --people.
        frames: default of the option --frames.
    """

    people = "2,3,4,5,6,7"
    frames = 12

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        people = numbers(1, 64)
        parser.add_argument(
            "--rig", type=Path, metavar="FILE", required=True, help="calibration, e.g. of the Panoptic Studio"
        )
        parser.add_argument(
            "--people",
            type=people,
            default=people(cls.people),
            metavar="N,N",
            help=f"numbers of people; default {cls.people}",
        )
        parser.add_argument(
            "--frames",
            type=within(int, 1, 10**6),
            default=cls.frames,
            metavar="N",
            help=f"frames per number of people; default {cls.frames}",
        )
        add_seeds(parser, "0")
        parser.add_argument(
            "--noise",
            type=within(float, 1e-6, 0.1),
            default=0.012,
            metavar="SHARE",
            help="standard deviation of 2D joints, as a share of the diagonal of the person's box; "
            "default .012",
        )
        add_settings(parser, "one parameter of voting or assembly, for every method")
        parser.add_argument(
            "--preset",
            default=PAPER,
            metavar="NAME",
            help=f"configuration beside the default: a preset or a YAML file; default {PAPER}; {NOTHING} = "
            "none",
        )

    @property
    def methods(self) -> list[Method]:
        """Return the default method, and the method of the preset if there is one."""
        settings = read_parameters(None, self.options.settings)
        preset = read_preset("" if self.options.preset == NOTHING else self.options.preset)
        if preset is NO_PRESET:
            return [Method(settings=settings)]
        own = Method(preset.name, merged(preset.parameters, settings), preset.skeleton)
        return [Method(settings=settings), own]

    def cases(self) -> list[Case]:
        """See `Study`."""
        return [
            Case(f"{people} people", (people, seed), float(people))
            for people in self.options.people
            for seed in self.options.seeds
        ]


class Nodes(RigStudy):
    """Accuracy of nodes and skeletons with all cameras (Table 3 of Joo et al. 2017)."""

    columns = (
        Column("people", "people"),
        Column("cameras", "cameras"),
        Column("kind", "kind"),
        Column("method", "method"),
        Column("nodes", "nodes"),
        Column("outlier_nodes", "outliers"),
        Column("missed_nodes", "missed"),
        Column("ghosts", "ghosts"),
        Column("node_accuracy", "node acc.", ".2%"),
        Column("skeleton_accuracy", "skel. acc.", ".2%"),
        Column("median_mm", "median mm", ".1f"),
        *(Column(f"pck_{100 * limit:.0f}cm", f"PCK {100 * limit:.0f} cm", ".3f") for limit in PCK),
    )
    has_plot = True

    def counts(self, rig: Rig) -> list[int]:
        """Return the numbers of cameras in decreasing order."""
        return [len(rig)]

    def measure(self, case: Case, progress: Progress) -> Iterator[Row]:
        """See `Study`."""
        people, seed = case.request
        given = self.options
        rig = of_type(given.rig, "vga")
        take = simulate(study_scene(rig, people, AREA, relative_noise(given.noise)), seed, given.frames)
        progress(0.0, f"2D people in {len(rig)} views")
        sets, truth = list(take.detection_sets()), truth_of(take)
        ways = [(count, method) for count in self.counts(rig) for method in self.methods]
        for (count, method), told in zip(ways, shared_out(progress, [count for count, _ in ways])):
            told(0.0, f"{count} cameras, {method.name}")
            found = score(truth, solve(method, farthest_first(take.rig, count), SKELETON, sets).skeletons)
            about = {"people": people, "seed": seed, "cameras": count, "kind": "given"}
            yield with_curve(about | {"method": method.name} | found.to_mapping())

    def lines(self, result: Result) -> Iterable[str]:
        """See `Study`."""
        yield from super().lines(result)
        if len({row["people"] for row in result["rows"]}) > 1:
            yield ""
            for rows in grouped(result["rows"], _kind).values():
                yield _together(rows)

    def plot(self, path: Path, result: Result) -> None:
        """See `Study`."""
        # imported here because matplotlib is slow to load
        from panoptic_ros.view.study_plots import write_study_plot

        write_study_plot(path, result["rows"], f"PCK, {self.source}")

    @property
    def source(self) -> str:
        """Return the source of the 2D poses, for the title of the plot."""
        return f"simulated detector, noise {100 * self.options.noise:g} % of the person's size"


class Cameras(Nodes):
    """PCK curves by the number of cameras (Fig. 8 of Joo et al. 2017)."""

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        super().add_options(parser)
        parser.add_argument(
            "--cameras",
            type=numbers(2, 10**4),
            default=(480, 240, 160, 80, 40, 20, 10),
            metavar="N,N",
            help="numbers of cameras; default 480,240,160,80,40,20,10",
        )

    def counts(self, rig: Rig) -> list[int]:
        """Return the requested numbers of cameras in decreasing order, limited to the cameras of the rig."""
        return sorted({min(count, len(rig)) for count in self.options.cameras}, reverse=True)


def with_curve(row: Row) -> Row:
    """Return the row with the PCK at the distances of the table."""
    at = {f"pck_{100 * limit:.0f}cm": int((THRESHOLDS < limit - 1e-9).sum()) for limit in PCK}
    return row | {key: row["pck"][index] for key, index in at.items()}


def of_type(path: Path, kind: str) -> Rig:
    """Return the cameras of one type, or all cameras if the file has no types."""
    try:
        return read_rig(path, types=(kind,))
    except UsageError:
        return read_rig(path)


def _kind(row: Row) -> tuple[str, str]:
    """Return the name of the camera group and the name of the method."""
    return f"{row['cameras']} {'cameras' if row['kind'] == 'given' else row['kind']}", row["method"]


def _together(rows: list[dict[str, Any]]) -> str:
    """Return one line with the accuracy of nodes and skeletons over all numbers of persons, as in Table 3."""
    nodes, skeletons = (sum(row[key] for row in rows) for key in ("nodes", "skeletons"))
    wrong = sum(row["outlier_nodes"] + row["missed_nodes"] for row in rows)
    right = sum(row["skeletons"] * row["skeleton_accuracy"] for row in rows)
    return (
        f"{', '.join(_kind(rows[0]))}: {skeletons} skeletons, {nodes} nodes, {wrong} outliers or missed: "
        f"accuracy of nodes {100 * (1 - wrong / nodes):.2f} %, of skeletons {100 * right / skeletons:.2f} %"
    )
