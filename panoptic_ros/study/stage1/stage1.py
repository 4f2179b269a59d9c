"""The study `stage1`: every stage from 2D poses or score maps to skeletons, next to named baselines.

Each case runs in a fresh process with one thread. The package docstring lists data and baselines.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.running.arguments import within
from panoptic_ros.stage import Progress
from panoptic_ros.study.child import run_child
from panoptic_ros.study.options import add_seeds, numbers, words
from panoptic_ros.study.stage1.any_skeleton import any_skeleton_world, in_joints_of
from panoptic_ros.study.stage1.baselines import given_rows, greedy_rows
from panoptic_ros.study.stage1.chain import mapped_rows, people_rows, voting_rows
from panoptic_ros.study.stage1.layouts import make_world
from panoptic_ros.study.stage1.rows import Rows
from panoptic_ros.study.study import Case, Column, Result, Row, Study, grouped, table
from panoptic_ros.study.world import World, bag_world

ALL = ("people", "maps", "voting", "baselines")  # parts of a case
DENSE_VIEWS = 31  # limit of views for the dense voter
MANY_PEOPLE, MANY_FRAMES = 7, 8
SKELETONS = "panoptic15,panoptic19,body25,blazepose33,wholebody133"
GROWTH = (
    Column("step", "growth: exponent b of time ~ size^b"),
    Column("method", "method"),
    Column("in", "in"),
    Column("at", "at"),
    Column("exponent", "b", ".2f"),
)


class Stage1(Study):
    """A grid of people and views, rigs of many views, other skeletons; or a recording."""

    columns = (
        Column("step", "step"),
        Column("method", "method"),
        Column("cpu_ms_median", "ms p50", ".3g"),
        Column("cpu_ms_p99", "p99", ".3g"),
        Column("peak_mb", "+ MB", ".0f"),
        Column("mpjpe_mm", "MPJPE mm", ".1f"),
        Column("person_recall", "recall", ".3f"),
        Column("person_precision", "precision", ".3f"),
        Column("note", ""),
    )

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        parser.add_argument(
            "--people",
            type=numbers(1, 64),
            default=(1, 4, 8),
            metavar="N,N",
            help="numbers of people; default 1,4,8",
        )
        parser.add_argument(
            "--views",
            type=numbers(2, 480),
            default=(3, 5, 10, 31),
            metavar="N,N",
            help="numbers of views; default 3,5,10,31",
        )
        parser.add_argument(
            "--many-views",
            type=numbers(0, 480),
            default=(96, 480),
            metavar="N,N",
            help="numbers of views of rigs of VGA cameras with smaller maps, without dense voting; "
            "default 96,480; 0 = none",
        )
        parser.add_argument(
            "--skeletons",
            type=words,
            default=words(SKELETONS),
            metavar="NAME,NAME",
            help="skeletons for the growth with the number of joints, at 4 people and 5 views; empty = "
            f"none; default {SKELETONS}",
        )
        parser.add_argument(
            "--frames",
            type=within(int, 2, 10**6),
            default=60,
            metavar="N",
            help="frames per case; default 60",
        )
        parser.add_argument(
            "--budget",
            type=within(float, 0.01, 60.0),
            default=0.5,
            metavar="S",
            help="processor time per row; default 0.5",
        )
        add_seeds(parser, "0")
        parser.add_argument(
            "--aniposelib", metavar="PYTHON", help="Python interpreter of an environment that has aniposelib"
        )
        bag = parser.add_argument_group("a recording instead of the simulation")
        bag.add_argument("--bag", type=Path, metavar="DIR", help="bag of `panoptic run`")
        bag.add_argument(
            "--cameras", type=words, default=[], metavar="NAME,NAME", help="use only these cameras"
        )
        bag.add_argument(
            "--skeleton",
            metavar="NAME",
            help="score the joints of this model, e.g. coco17; default: as recorded",
        )
        bag.add_argument("--truth", type=Path, metavar="FILE", help="true skeletons")
        bag.add_argument(
            "--volume",
            type=float,
            nargs=6,
            metavar="M",
            help="volume to search: least x y z, greatest x y z, in m",
        )

    def cases(self) -> list[Case]:
        """See `Study`."""
        given = self.options
        common = {"frames": given.frames, "budget_s": given.budget, "aniposelib": given.aniposelib}
        if given.bag:
            return [Case(str(given.bag), common | self._recorded())]
        found = []
        for seed in given.seeds:
            sized = common | {"seed": seed}
            for p in given.people:
                for v in given.views:
                    parts = [*ALL, *(["dense"] if v <= DENSE_VIEWS else [])]
                    found.append(_case("grid", p, v, sized | {"parts": parts}))
            for v in filter(None, given.many_views):
                many = {"frames": min(MANY_FRAMES, given.frames), "parts": list(ALL[:3])}
                found.append(_case("many", MANY_PEOPLE, v, sized | many))
            for name in given.skeletons:
                found.append(_case("joints", 4, 5, sized | {"skeleton": name, "parts": list(ALL[:3])}))
        return found

    def _recorded(self) -> dict[str, Any]:
        given = self.options
        return {
            "kind": "bag",
            "bag": str(given.bag),
            "cameras": given.cameras,
            "skeleton": given.skeleton,
            "truth": str(given.truth) if given.truth else None,
            "volume": given.volume,
            "parts": [*ALL, "dense"],
        }

    def measure(self, case: Case, progress: Progress) -> list[Row]:
        """See `Study`."""
        about = {"case": case.title, "kind": case.request["kind"]}
        return [about | row for row in run_child(measure_case, case.request)]

    def summary(self, rows: list[Row]) -> dict[str, Any]:
        """See `Study`."""
        return {"growth": growth(rows)}

    def lines(self, result: Result) -> Iterable[str]:
        """See `Study`."""
        yield "Processor time per instant, one thread, first call excluded; accuracy on the same 2D people."
        for title, rows in grouped(result["rows"], lambda row: row["case"]).items():
            maps = rows[0]["maps"]
            yield from ("", f"{title} (maps {maps[0]}x{maps[1]})" if maps else title)
            yield from table(rows, self.columns)
        checks = [row["equal_to_exact"] for row in result["rows"] if "equal_to_exact" in row]
        if checks:
            yield f"exact voting gives what dense voting gives: {'yes' if all(checks) else 'NO'}"
        if result["growth"]:
            yield from ("", *table(result["growth"], GROWTH))


def _case(kind: str, people: int, views: int, request: dict[str, Any]) -> Case:
    title = f"{people} people, {views} views {request.get('skeleton', '')}".strip()
    return Case(title, request | {"kind": kind, "people": people, "views": views}, float(people * views))


def growth(rows: Sequence[Row]) -> list[Row]:
    """Fit the exponent of the median time of every method in views, persons and joints, all else equal."""
    grid = [row for row in rows if row["kind"] == "grid"]
    most = max((row["people"] for row in grid), default=0)
    sizes = sorted({row["views"] for row in grid})
    middle = sizes[len(sizes) // 2] if sizes else 0
    series = {
        ("views", f"{most} people"): [row for row in grid if row["people"] == most],
        ("people", f"{middle} views"): [row for row in grid if row["views"] == middle],
        ("joints", "4 people, 5 views"): [row for row in rows if row["kind"] == "joints"],
    }
    found = []
    for (what, where), members in series.items():
        timed = [row for row in members if row.get("calls")]
        for (step, method), own in grouped(timed, lambda row: (row["step"], row["method"])).items():
            power = exponent([row[what] for row in own], [row["cpu_ms_median"] for row in own])
            if power is not None:
                found.append({"in": what, "at": where, "step": step, "method": method, "exponent": power})
    return found


def exponent(sizes: Sequence[float], times: Sequence[float]) -> float | None:
    """Return b of time = a * size^b by least squares on the logarithms; None with fewer than two sizes."""
    if len(set(sizes)) < 2:
        return None
    return float(np.polyfit(np.log(sizes), np.log(times), 1)[0])


def measure_case(request: dict[str, Any]) -> list[Row]:
    """Return the rows of a case.

    Args:
        request: parts (of ALL, and dense) and budget_s. Source: people, views, frames and seed, with skeleton
            as an option; or bag, cameras and truth.
    """
    parts = set(request["parts"])
    world = _world(request, bool(parts & {"maps", "voting"}))
    rows = Rows(world, request["budget_s"])
    if "people" in parts:
        people_rows(rows)
    if world.mapped and "maps" in parts:
        mapped_rows(rows)
    if world.mapped and "voting" in parts:
        voting_rows(rows, "dense" in parts)
    if "baselines" in parts:
        greedy_rows(rows)
        if world.given:
            given_rows(rows, request.get("aniposelib"))
    about = {
        "people": max((len(frame.ids) for frame in world.truth.frames), default=0) if world.truth else None,
        "views": len(world.rig),
        "joints": len(world.skeleton),
        "frames": len(world.sets),
        "maps": _grid(world),
    }
    return [about | row for row in rows.rows]


def _world(request: dict[str, Any], maps: bool) -> World:
    if request.get("bag"):
        truth = Path(request["truth"]) if request.get("truth") else None
        world = bag_world(
            Path(request["bag"]), request["cameras"], truth, request["frames"], request.get("volume")
        )
        return in_joints_of(world, request["skeleton"]) if request.get("skeleton") else world
    if request.get("skeleton"):
        return any_skeleton_world(
            request["skeleton"], request["people"], request["views"], request["frames"], request["seed"]
        )
    return make_world(request["people"], request["views"], request["frames"], request["seed"], maps)


def _grid(world: World) -> list[int] | None:
    for item in world.sets:
        for view in item.views:
            if view.maps is not None:
                return list(view.maps.grid_size)
    return None
