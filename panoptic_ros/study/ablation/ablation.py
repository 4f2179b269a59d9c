"""The study `ablation`: switch off one mechanism of the core at a time and solve the same 2D poses again."""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Iterable
from contextlib import ExitStack
from dataclasses import replace
from typing import Any
from unittest.mock import patch

from panoptic_ros.errors import UsageError
from panoptic_ros.running.arguments import within
from panoptic_ros.stage import Progress
from panoptic_ros.study.ablation.differences import DEFAULT, summary
from panoptic_ros.study.ablation.figures import FIGURES, Figure, figures_of, solve
from panoptic_ros.study.ablation.mechanisms import MECHANISMS, Mechanism, chosen
from panoptic_ros.study.child import run_child
from panoptic_ros.study.cropping import HALF
from panoptic_ros.study.options import add_recordings, add_seeds, recordings, words
from panoptic_ros.study.study import Case, Column, Result, Row, Study, table
from panoptic_ros.study.world import VARIANTS, World, frames_of, recorded_world, simulated_world, split

RECORDING_COST = 3000.0  # assumed cost of a recording of unknown size, in frames x people x views
RENDERING_COST = 4.0  # cost of a rendered frame relative to a simulated one
SIMULATED = (
    "clean-4p5v",
    "noisy-4p5v+2views",
    "noisy-4p5v+maps",
    "noisy-4p5v+unlisted",
    "noisy-8p5v",
    "noisy-8p10v",
    "noisy-8p31v",
    "three-views-2p",
    "sitting-group-6p5v",
    "sitting-group-6p5v+maps",
    "crossing",
    "embrace-2p5v",
    "occluded",
    "bystanders",
    "exchanged-4p5v",
    "fragments-8p5v",
    "noisy-8p5v+slow",
    "enter-leave",
    "unsync-5v",
    "mixed-rates",
    "rendered-4p6v",
    "rendered-3p8v",
    "rendered-table-4p8v",
)
LEGEND = (
    "Change of each figure when a mechanism is off, with its standard error; * = more than chance (95 %).",
    "Misfit: by how many points the share of joints within their 95 % ellipsoids is not 95.",
    "Errors are over seeds, or over stretches of a recording; `all scenes` gives each scene the same weight.",
)
COLUMNS = (Column("name", ""), *(Column(figure.key, figure.title) for figure in FIGURES))


class Ablation(Study):
    """Every case is solved in a process of one thread, by default and with each mechanism off."""

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        add_seeds(parser, "0:3")
        parser.add_argument(
            "--scenes",
            type=words,
            default=list(SIMULATED),
            metavar="NAME,NAME",
            help="scenes of `panoptic simulate`. Variants of scenes that are not rendered: append "
            f"{', '.join('+' + word for word in VARIANTS)} (drawn score maps; a person who is in score "
            "maps only; two cameras only; 5 instants per second). Empty = none; default "
            f"{','.join(SIMULATED)}",
        )
        add_recordings(parser)
        parser.add_argument(
            "--cropped",
            action="store_true",
            help="solve every case also with the central half of each image, so that borders cut people; "
            "2D poses without images lose the joints outside",
        )
        parser.add_argument(
            "--only",
            type=words,
            default=[],
            metavar="NAME,NAME",
            help="only these mechanisms, or all mechanisms of these parts",
        )
        parser.add_argument(
            "--frames", type=within(int, 3, 10**6), metavar="N", help="greatest number of frames per scene"
        )
        parser.add_argument("--model", default="movenet-multipose", help="detector of rendered scenes")
        parser.add_argument(
            "--jobs", type=within(int, 1, 64), default=1, metavar="N", help="parallel processes; default 1"
        )

    def cases(self) -> list[Case]:
        """See `Study`."""
        given = self.options
        only = [mechanism.name for mechanism in chosen(given.only)]
        found = [self._scene(name, seed, only) for name in given.scenes for seed in given.seeds]
        found += [
            Case(" ".join(paths), {"paths": paths, "only": only}, RECORDING_COST)
            for paths in recordings(given)
        ]
        if not found:
            raise UsageError("there is nothing to solve: give --scenes or --capture")
        if given.cropped:
            found += [
                replace(case, title=f"{case.title} cropped", request=case.request | {"shares": HALF})
                for case in found
            ]
        return found

    def _scene(self, name: str, seed: int, only: list[str]) -> Case:
        scene, _ = split(name)
        frames = frames_of(name, self.options.frames)
        request = {"scene": name, "seed": seed, "frames": frames, "model": self.options.model, "only": only}
        views = getattr(scene.rig, "cameras", 1)
        cost = frames * (len(scene.activities) + 2) * views * (RENDERING_COST if scene.rendered else 1.0)
        return Case(name, request, cost)

    def measure(self, case: Case, progress: Progress) -> list[Row]:
        """See `Study`."""
        about = {"scene": case.title, "seed": case.request.get("seed")}
        return [about | row for row in run_child(measure_case, case.request)]

    def summary(self, rows: list[Row]) -> dict[str, Any]:
        """See `Study`."""
        mechanisms = chosen(self.options.only)
        return {
            "seeds": list(self.options.seeds),
            "mechanisms": [
                {"part": m.part, "name": m.name, "about": m.about, "off": m.off} for m in mechanisms
            ],
            "scenes": summary(rows, [m.name for m in mechanisms]),
        }

    def lines(self, result: Result) -> Iterable[str]:
        """Yield the lines of the report on the solutions without one mechanism each.

        They are the legend, a table over all scenes, a table per scene, the mechanisms without which no
        figure gets clearly worse, and a list of all mechanisms. The table of one scene omits mechanisms that
        change no quality figure in that scene.
        """
        everything, *scenes = result["scenes"]
        seeds, mechanisms = result["seeds"], result["mechanisms"]
        yield from (*LEGEND, f"Seeds {seeds[0]} to {seeds[-1]}.", "", *_block(everything, mechanisms, True))
        for scene in scenes:
            yield from ("", *_block(scene, mechanisms, False))
        idle = [m["name"] for m in mechanisms if earns_nothing(m["name"], result["scenes"])]
        yield from (
            "",
            "No figure is clearly worse anywhere without: " + (", ".join(idle) or "(none of them)"),
        )
        yield from ("", *table(mechanisms, (Column("name", ""), Column("part", ""), Column("about", "")))[1:])


def measure_case(request: dict[str, Any]) -> list[Row]:
    """Return the figures of every run, with the name of the mechanism that was off; `DEFAULT` = none.

    Args:
        request: only (names of mechanisms); shares (central window of the images), if they are cropped; and
            either scene, seed, frames and model, or paths of a recording.
    """
    shares = request.get("shares")
    if "paths" in request:
        world = recorded_world(request["paths"], shares)
    else:
        scene, seed, frames, model = (request[key] for key in ("scene", "seed", "frames", "model"))
        world = simulated_world(scene, seed, frames, model, shares)
    runs = [Mechanism("", DEFAULT, "", {})]
    runs += [m for m in MECHANISMS if m.name in request["only"] and _acts(m, world)]
    _solved(world, runs[0])  # the first run has cold caches
    return [{"off": run.name} | figures for run in runs for figures in _solved(world, run)]


def _acts(mechanism: Mechanism, world: World) -> bool:
    return world.mapped or not mechanism.maps


def _solved(world: World, mechanism: Mechanism) -> list[dict[str, float]]:
    """Return the figures of a world without a mechanism."""
    assert world.truth is not None  # all cases have one
    with ExitStack() as substitutes:
        for place, substitute in mechanism.replaced:
            module, _, name = place.partition(":")
            owner, _, attribute = name.rpartition(".")
            target = importlib.import_module(module)
            target = getattr(target, owner) if owner else target
            substitutes.enter_context(patch.object(target, attribute, substitute, create=True))
        return figures_of(world.truth, solve(world, mechanism.off), world.stretches)


def earns_nothing(name: str, scenes: list[dict[str, Any]]) -> bool:
    """Return whether no quality figure is clearly worse without the mechanism, in each scene and overall."""
    return not any(
        _is_worse(scene["off"][name][figure.key], figure)
        for scene in scenes
        if name in scene["off"]
        for figure in FIGURES
    )


def _is_worse(change: dict[str, Any], figure: Figure) -> bool:
    return bool(change["clear"] and change["mean"] * figure.worse > 0.0)


def _block(scene: dict[str, Any], mechanisms: list[dict[str, Any]], whole: bool) -> list[str]:
    default = {f.key: _plain(scene["default"][f.key], f) for f in FIGURES}
    rows: list[Row] = [{"name": "default"} | default]
    for mechanism in mechanisms:
        changes = scene["off"].get(mechanism["name"])
        if changes and (whole or any(changes[f.key]["mean"] for f in FIGURES if f.worse)):
            rows.append({"name": mechanism["name"]} | {f.key: _cell(changes[f.key], f) for f in FIGURES})
    return [f"{scene['scene']} ({scene['samples']})", *(f"  {line}" for line in table(rows, COLUMNS))]


def _plain(value: float | None, figure: Figure) -> str:
    return "-" if value is None else f"{value:.{figure.digits}f}"


def _cell(change: dict[str, Any], figure: Figure) -> str:
    if change["mean"] is None:
        return "-"
    error = "" if change["error"] is None else f" ±{change['error']:.{figure.digits}f}"
    return f"{change['mean']:+.{figure.digits}f}{error}{'*' if change['clear'] else ''}"
