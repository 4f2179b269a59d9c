"""The study `child`: how long a child whom adults hide is lost, whether it keeps its id, who loses it."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from panoptic_ros.domain import AssociationSet, DetectionSet, Rig, SkeletonModel, ViewDetections
from panoptic_ros.evaluation.pairing import FOUND, match_people
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.nodes import FUSION
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.io.detector_context import detector_extras
from panoptic_ros.running.plans.parameters import read_parameters
from panoptic_ros.simulation import Simulation
from panoptic_ros.stage import Progress, StageContext
from panoptic_ros.study.options import add_seeds, add_settings
from panoptic_ros.study.people.hidden_child_takes import ADULTS, CHILD, KINDS, child_take, images_of
from panoptic_ros.study.study import Case, Column, Result, Row, Study
from panoptic_ros.study.world import DETECTED, detected_sets

Array = np.ndarray
Settings = Mapping[str, Mapping[str, Any]]
SETTLED = 1.0  # s, at the beginning, that do not count
ALLOWED = 0.2  # s, for which the child may be lost
OWN = 0.12  # m, median distance of a 2D person's joints from those of the person whom it shows
RECORDS = ("associations", "poses", "skeletons_raw", "skeletons")
LOSERS = ("detection", "association", "assembly", "tracking", "refinement")


@dataclass(frozen=True)
class ChildInstant:
    """One instant of a take.

    Args:
        number: id of the child; None: lost.
        gap: m, mean distance of its joints from the truth; NaN: lost.
        shown: number of views with a 2D person of it.
        loser: the stage that lost it; "": none.
        ghosts: number of skeletons without a person.
        others: ids of the adults, by their number.
    """

    seconds: float
    number: int | None
    gap: float
    shown: int
    loser: str
    ghosts: int
    others: Mapping[int, int]


def follow_child(
    take: Simulation, sets: Sequence[DetectionSet], skeleton: SkeletonModel, settings: Settings
) -> Iterator[ChildInstant]:
    """Solve the 2D people of a take, and find the child after every stage."""
    records: dict[str, list[Any]] = {topic: [] for topic in RECORDS}
    pipeline = Pipeline(
        configure(settings),
        StageContext(take.rig, skeleton),
        FUSION,
        on_record=lambda topic, record: records[topic].append(record) if topic in records else None,
    )
    for item in sets:
        pipeline.push("detection_sets", item)
    pipeline.flush()
    ticks = take.schedule.ticks
    truths = np.stack([person.joints(ticks) for person in take.people], axis=1)
    for tick, truth, item, *results in zip(ticks, truths, sets, *records.values(), strict=True):
        shows = [shown_people(view, take.rig, truth) for view in item.views]
        shown = sum(CHILD in rows for rows in shows)
        found = [dict(match_people(truth, result.positions)[0].tolist()) for result in results[1:]]
        have = [shown > 0, in_a_group(results[0], shows), *(CHILD in rows for rows in found)]
        last, rows = results[-1], found[-1]
        loser = "" if have[-1] else LOSERS[have.index(False)]
        gap = float("nan")
        if CHILD in rows:
            gap = float(np.nanmean(np.linalg.norm(last.positions[rows[CHILD]] - truth[CHILD], axis=-1)))
        numbers = {person: int(last.ids[row]) for person, row in rows.items()}
        yield ChildInstant(
            float(tick), numbers.pop(CHILD, None), gap, shown, loser, len(last.ids) - len(rows), numbers
        )


def shown_people(view: ViewDetections, rig: Rig, truth: Array) -> list[int]:
    """Return which (D,) of the people (P, J, 3) m, world, each 2D person of a view shows; -1: none."""
    camera = rig.cameras[rig.index(view.camera)]
    pixels, seen = camera.project(truth)
    depth = camera.cam_from_world.apply(truth)[..., 2]
    scale = depth / camera.intrinsics.matrix[0, 0]  # m per px
    rows = []
    for points in view.points:
        gaps = np.where(seen, np.linalg.norm(points - pixels, axis=-1) * scale, np.nan)
        there = np.asarray(np.isfinite(gaps).any(axis=1))
        medians = np.where(there, np.nanmedian(np.where(there[:, None], gaps, 0.0), axis=1), np.inf)
        rows.append(int(medians.argmin()) if medians.min() < OWN else -1)
    return rows


def in_a_group(item: AssociationSet, shows: Sequence[Sequence[int]]) -> bool:
    """Return whether at least half of the 2D people of some group are the child's.

    Args:
        shows: for each view of the set, the result of `shown_people`.
    """
    evidence = item.evidence
    whom = np.array([shows[evidence.slots[v]][row] for v, row in zip(evidence.view, evidence.rows)], int)
    for member in item.groups.member:
        own = member[member >= 0]
        if len(own) and 2 * np.count_nonzero(whom[own] == CHILD) >= len(own):
            return True
    return False


def child_figures(instants: Sequence[ChildInstant]) -> dict[str, Any]:
    """Sum up the instants after the first second: times at which the child was lost, ids, losers."""
    period = (instants[-1].seconds - instants[0].seconds) / (len(instants) - 1)
    counted = [now for now in instants if now.seconds > SETTLED]
    longest = run = 0
    for now in counted:
        run = run + 1 if now.number is None else 0
        longest = max(longest, run)
    numbers = {now.number for now in counted if now.number is not None}
    lost = [now for now in counted if now.number is None]
    adults: dict[int, set[int]] = {}
    for now in counted:
        for person, number in now.others.items():
            adults.setdefault(person, set()).add(number)
    return {
        "lost_s": period * len(lost),
        "longest_s": period * longest,
        "kept": len(numbers) == 1,
        "far_s": period * sum(now.gap >= FOUND for now in counted),
        "losers": dict(Counter(now.loser for now in lost)),
        "least_views": min(now.shown for now in counted),
        "ghosts": sum(now.ghosts for now in counted) / len(counted),
        "adults_kept": [len(ids) for ids in adults.values()] == [1] * ADULTS,
        "adults_missed": sum(ADULTS - len(now.others) for now in counted) / len(counted),
    }


class Child(Study):
    """Takes are rendered, detected, solved, and the child is found after every stage."""

    columns = (
        Column("seed", "seed"),
        Column("cameras", "cameras"),
        Column("rate", "Hz", ".1f"),
        Column("lost_s", "lost s", ".2f"),
        Column("longest_s", "at most", ".2f"),
        Column("kept", "id kept"),
        Column("lost_by", "lost by"),
        Column("ghosts", "ghosts", ".3f"),
    )

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        add_seeds(parser, "0:20")
        parser.add_argument("--kind", choices=tuple(KINDS), default="usual", help="of takes; default usual")
        add_settings(parser)

    def cases(self) -> list[Case]:
        """See `Study`."""
        return [Case(f"take {seed}", seed) for seed in self.options.seeds]

    def measure(self, case: Case, progress: Progress) -> list[Row]:
        """See `Study`."""
        skeleton, extras = detector_extras("movenet-multipose", DETECTED)
        take = child_take(case.request, KINDS[self.options.kind])
        sets = list(detected_sets(StageContext(take.rig, skeleton, extras), images_of(take)))
        stamped = [replace(item, stamp_ns=take.master_ns(t)) for item, t in zip(sets, take.schedule.ticks)]
        settings = read_parameters(None, self.options.settings)
        found = child_figures(list(follow_child(take, stamped, skeleton, settings)))
        losers = ", ".join(f"{name} {count}" for name, count in found["losers"].items()) or "nobody"
        about = {"seed": case.request, "cameras": len(take.rig), "rate": take.scene.timing.rate}
        return [about | found | {"lost_by": losers}]

    def summary(self, rows: list[Row]) -> dict[str, Any]:
        """See `Study`."""
        good = sum(row["longest_s"] <= ALLOWED and row["kept"] for row in rows)
        return {"kind": self.options.kind, "good": good}

    def lines(self, result: Result) -> Iterator[str]:
        """See `Study`."""
        yield from super().lines(result)
        yield f"lost for at most 0.2 s with the id kept: {result['good']} of {len(result['rows'])} takes"
