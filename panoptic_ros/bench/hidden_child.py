"""For how long a child whom adults hide is lost, whether it keeps its id, and which stage loses it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from panoptic_ros.bench.hidden_child_takes import ADULTS, CHILD, KINDS, child_take, images_of
from panoptic_ros.bench.rendered import SKELETON, detected_sets
from panoptic_ros.domain import AssociationSet, DetectionSet, Rig, SkeletonModel, ViewDetections
from panoptic_ros.errors import UsageError
from panoptic_ros.evaluation.pairing import FOUND, match_people
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.nodes import FUSION
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.io.detector_context import detector_extras
from panoptic_ros.simulation import Simulation
from panoptic_ros.stage import Progress, StageContext, untold

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


def study_child(
    count: int,
    seed: int,
    kind: str = "usual",
    settings: Settings = MappingProxyType({}),
    progress: Progress = untold,
) -> dict[str, Any]:
    """Render `count` takes of a kind from a seed on, detect, solve, and tell what became of the child.

    Raises:
        UsageError: if there is no such kind.
        UserError: if the detector cannot be loaded.
    """
    if kind not in KINDS:
        raise UsageError(f"--scenes {kind}: there is no such kind of takes; there are {', '.join(KINDS)}")
    skeleton, extras = detector_extras("movenet-multipose", SKELETON)
    rows = []
    for number in range(seed, seed + count):
        progress((number - seed) / count, f"take {number}")
        take = child_take(number, KINDS[kind])
        sets = list(detected_sets(StageContext(take.rig, skeleton, extras), images_of(take)))
        stamped = [replace(item, stamp_ns=take.master_ns(t)) for item, t in zip(sets, take.schedule.ticks)]
        found = child_figures(list(follow_child(take, stamped, skeleton, settings)))
        rows.append({"seed": number, "cameras": len(take.rig), "rate": take.scene.timing.rate, **found})
    progress(1.0, "takes")
    good = sum(row["longest_s"] <= ALLOWED and row["kept"] for row in rows)
    return {"study": "child", "kind": kind, "takes": rows, "good": good}
