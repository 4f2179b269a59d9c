"""The study `continuous`: cameras that were never synchronised (Elhayek et al. 2012, Fig. 6 to 8).

The captures are simulated and reproduce no sequence of the paper. As in the paper, the reference is the same
rig, synchronous at 70 Hz, and the other methods get the images of free-running cameras.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np

from panoptic_ros.continuous.config import ContinuousConfig
from panoptic_ros.continuous.elhayek.passes import DEGREE, IMAGE_DEGREE
from panoptic_ros.running.arguments import within
from panoptic_ros.simulation.free_running import simulate_free_running
from panoptic_ros.simulation.free_running_scenes import FREE_RUNNING_SCENES
from panoptic_ros.stage import Progress, each
from panoptic_ros.study.continuous.clock_figures import TIME_KEYS, UNKNOWNS
from panoptic_ros.study.continuous.figures import SPEEDS, figures_of
from panoptic_ros.study.continuous.methods import METHODS, OF_CASE, REFERENCE_HZ, CaptureUnderTest
from panoptic_ros.study.options import add_seeds, known_names, words
from panoptic_ros.study.study import Case, Column, Result, Row, Study, averaged, grouped, table

Array = np.ndarray
RESULT_HZ = 100.0  # rate of the instants at which results are scored: also between the samples of all methods
EXACT = "cam00"  # camera whose clock and line delay are right
CONFIGS = {  # unknowns of the continuous pass; other cases have none
    "clocks": ContinuousConfig(clocks=True, trusted_camera=EXACT),
    "shutter": ContinuousConfig(rolling_shutter=True, trusted_camera=EXACT),
    "both": ContinuousConfig(clocks=True, rolling_shutter=True, trusted_camera=EXACT),
    "still": ContinuousConfig(clocks=True, trusted_camera=EXACT),
}
# seconds of a case and seed, measured
COSTS = {
    "faster": 35.0,
    "crossing": 40.0,
    "free": 8.0,
    "clocks": 13.0,
    "shutter": 16.0,
    "both": 25.0,
    "still": 20.0,
    "visitors": 40.0,
    "rendered": 65.0,
}
SPEED_KEYS = tuple(f"speed_{low:g}_{high:g}_m" for low, high in pairwise(SPEEDS))


class Continuous(Study):
    """Error of every method in captures of free-running cameras, by case and by speed."""

    columns = (
        Column("case", "case"),
        Column("method", "method"),
        Column("mean_m", "mean mm", ".1f", 1e3),
        Column("last_m", "last quarter", ".1f", 1e3),
        Column("p95_m", "95 %", ".1f", 1e3),
        Column("mean_ratio", "mean / ref.", ".2f"),
        Column("last_ratio", "last / ref.", ".2f"),
        Column("acceleration_error", "m/s2", ".1f"),
        Column("bone_spread_m", "bones mm", ".2f", 1e3),
        Column("output", "output", ".1%"),
        Column("in_ellipsoid", "in ellipsoid", ".1%"),
        Column("in_ellipsoid_last", "last", ".1%"),
        Column("ids", "ids", ".2f"),
        Column("mixed_ids", "mixed ids", ".2f"),
        Column("wrong_views", "wrong views", ".2%"),
        Column("missing_s", "missing s", ".2f"),
        Column("false_s", "false s", ".1f"),
        Column("false_people", "false people", ".1f"),
        Column("cpu_share", "CPU s", ".2f"),
    )
    speeds = (
        Column("case", "case"),
        Column("method", "method"),
        *(
            Column(key, f"{low:g}-{high:g} m/s", ".1f", 1e3)
            for key, low, high in zip(SPEED_KEYS, SPEEDS, SPEEDS[1:])
        ),
    )
    times = (
        Column("case", "case"),
        Column("offset_error", "offset ms", ".2f", 1e3),
        Column("offset_z2", "z2", ".1f"),
        Column("offset_known", "observable", ".0%"),
        Column("drift_error", "drift ppm", ".0f", 1e6),
        Column("drift_z2", "z2", ".1f"),
        Column("drift_known", "observable", ".0%"),
        Column("line_error", "line us", ".2f", 1e6),
        Column("line_z2", "z2", ".1f"),
        Column("line_known", "observable", ".0%"),
    )
    over = ("case", "method")
    has_plot = True

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        names = list(FREE_RUNNING_SCENES)
        parser.add_argument(
            "--cases",
            type=words,
            default=names,
            metavar="NAME,NAME",
            help=f"cases; default {','.join(names)}",
        )
        add_seeds(parser, "1:4")
        parser.add_argument(
            "--seconds",
            type=within(float, 2.0, 600.0),
            metavar="S",
            help="length of each capture; default: that of the case",
        )

    def cases(self) -> list[Case]:
        """See `Study`."""
        return [
            Case(f"{name}, seed {seed}", (name, seed), COSTS.get(name, 9.0))
            for name in known_names(self.options.cases, FREE_RUNNING_SCENES, "case")
            for seed in self.options.seeds
        ]

    def measure(self, case: Case, progress: Progress) -> Iterator[Row]:
        """See `Study`."""
        _warm_up()
        name, seed = case.request
        scene = FREE_RUNNING_SCENES[name]
        if self.options.seconds:
            scene = replace(scene, seconds=self.options.seconds)
        capture = simulate_free_running(scene, seed)
        times = np.arange(1, int(scene.seconds * RESULT_HZ)) / RESULT_HZ
        task = CaptureUnderTest(capture, times, CONFIGS.get(name, ContinuousConfig()))
        at_work = float(capture.present(times).sum()) / RESULT_HZ  # person-seconds
        unit: Row = {}
        methods = OF_CASE.get(name, METHODS)
        for method, solve in each(methods.items(), len(methods), progress, "methods"):
            found = solve(task)
            instants = (
                times
                if method != "reference"
                else np.arange(int(scene.seconds * REFERENCE_HZ)) / REFERENCE_HZ
            )
            figures = figures_of(capture, instants, found.frames)
            unit = unit or figures
            by_speed = dict(zip(SPEED_KEYS, figures.pop("by_speed_m")))
            yield {
                "case": name,
                "seed": seed,
                "method": method,
                **figures,
                **by_speed,
                "mean_ratio": figures["mean_m"] / unit["mean_m"],
                "last_ratio": figures["last_m"] / unit["last_m"],
                "wrong_views": found.wrong_views,
                "cpu_share": found.cpu_s / at_work,
                **dict.fromkeys(TIME_KEYS, np.nan),
                **found.times,
            }

    def head(self, result: Result) -> str:
        """See `Study`."""
        return (
            "Simulated captures: they reproduce no sequence of the paper. Errors in mm at 100 Hz, of the "
            "reference at its own instants.\n"
            "`ref.`: the same rig, synchronous at 70 Hz, true association. `low rate`: the frames of the "
            "reference at the lowest rate of a camera.\n"
            "`aligned`: nearest frames treated as simultaneous, true association. `solve`: `panoptic solve` "
            "on the same groups.\n"
            "`lag`: the stage `continuous` at 50 Hz, each instant from the views up to the lag later.\n"
            "`elhayek`: `panoptic continuous --preset elhayek-2012`, polynomials of degree "
            f"{DEGREE} of joint angles.\n"
            "`maps`: with --score-maps, degree "
            f"{DEGREE}: maps drawn from the same 2D joints, a Gaussian of 1.3 cells each.\n"
            f"`images`: with --images, degree {IMAGE_DEGREE}: blobs of images instead of 2D joints.\n"
            "`subject`: `panoptic continuous --subject`, curves of joint angles of the first person, bones "
            "fitted.\n"
            "`m/s2`: mean error of second differences. `bones`: spread of the lengths of limbs over time.\n"
            "Unknown clocks and line delays (cases `clocks`, `shutter`, `both`, `still`) are estimated by "
            "`continuous` only.\n"
            "`z2`: mean square of errors in standard deviations; errors are those of observable values.\n"
            "Ids per person; ids that follow two people; longest time without a person who is there, of all "
            "seeds;\nperson-seconds of false people; processor time per person-second."
        )

    def lines(self, result: Result) -> Iterator[str]:
        """See `Study`."""
        rows = _averages(result["rows"])
        yield from (*self.head(result).splitlines(), "", *table(rows, self.columns))
        yield from ("", "error in mm by the speed of the joint", "", *table(rows, self.speeds))
        asked = [row for row in rows if any(row.get(f"{name}_known", np.nan) >= 0.0 for name in UNKNOWNS)]
        if asked:
            yield from ("", "clocks and line delays, apart from the trusted camera", "")
            yield from table(asked, self.times)
        yield ""
        yield from (f"{name}: {FREE_RUNNING_SCENES[name].about}" for name in grouped(rows, _case))

    def plot(self, path: Path, result: Result) -> None:
        """See `Study`."""
        # imported here because matplotlib is slow to load
        from panoptic_ros.view.speed_plots import write_speed_plot

        middles = [0.5 * (low + high) for low, high in pairwise(SPEEDS)]
        curves = {
            name: {row["method"]: [1e3 * row[key] for key in SPEED_KEYS] for row in own}
            for name, own in grouped(_averages(result["rows"]), _case).items()
        }
        write_speed_plot(path, middles, curves, "simulated captures of free-running cameras")


def _case(row: Row) -> str:
    name: str = row["case"]
    return name


def _averages(rows: list[Row]) -> list[Row]:
    """Return one row per case and method: means over the seeds, and the longest time without a person."""
    found = []
    for row, own in zip(averaged(rows, Continuous.over), grouped(rows, _key).values()):
        means = {key: value[0] if isinstance(value, tuple) else value for key, value in row.items()}
        found.append(means | {"missing_s": max(one["missing_s"] for one in own)})
    return found


def _key(row: Row) -> tuple[str, str]:
    return row["case"], row["method"]


@cache
def _warm_up() -> None:
    """Load the compiled kernels, so that the first case does not pay for them."""
    scene = replace(FREE_RUNNING_SCENES["free"], seconds=2.0)
    task = CaptureUnderTest(
        simulate_free_running(scene, 0), np.array([1.0]), ContinuousConfig(True, True, EXACT)
    )
    for method in ("solve", "continuous", "lag 0 s"):
        METHODS[method](task)
