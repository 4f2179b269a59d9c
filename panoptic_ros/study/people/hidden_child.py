"""The study `child`: time for which a child behind adults is lost, its identity, and the stage that loses it.

A child stands in the middle of three adults, in rendered takes. The adults stand, crouch, bend or reach. For
a while, all who crouch or bend are down together. The seed determines bodies, actions, cameras and timing.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from panoptic_ros.domain import AssociationSet, DetectionSet, Rig, SkeletonModel, ViewDetections, ViewFrame
from panoptic_ros.evaluation.pairing import FOUND, match_people
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.nodes import FUSION
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.io.detector_context import detector_extras
from panoptic_ros.running.plans.parameters import read_parameters
from panoptic_ros.simulation import SimulatedScene, Simulation, simulate
from panoptic_ros.simulation.body import BodyLengths, LowerBody
from panoptic_ros.simulation.gestures import draw_gesture
from panoptic_ros.simulation.motions import Motion, StandMotion
from panoptic_ros.simulation.people import SimulatedPerson, draw_sway
from panoptic_ros.simulation.rendering import Studio
from panoptic_ros.simulation.rigs import Lens, Ring
from panoptic_ros.simulation.smooth import Pulses, ease
from panoptic_ros.simulation.timing import Timing
from panoptic_ros.stage import Progress, StageContext
from panoptic_ros.study.options import add_seeds, add_settings
from panoptic_ros.study.study import Case, Column, Result, Row, Study
from panoptic_ros.study.world import DETECTED, detected_sets

CHILD, ADULTS = 0, 3  # index of the child, and number of adults
DOINGS = ("stand", "crouch", "bend", "reach")
IMAGES = ((640, 480), (640, 360), (800, 600), (512, 384))  # px
GOING = 0.5  # s, duration of a movement down or up
BENT, BACK = 0.9, 0.12  # forward lean of the trunk, rad; backward shift of the hips, m
TALLEST = 2.2  # m, minimum visible height at the distance of the middle
Array = np.ndarray
Settings = Mapping[str, Mapping[str, Any]]
SETTLED = 1.0  # s at the beginning that are not scored
ALLOWED = 0.2  # s for which the child may be lost
OWN = 0.12  # m, limit of the median joint distance between a 2D pose and its person
RECORDS = ("associations", "poses", "skeletons_raw", "skeletons")
LOSERS = ("detection", "association", "assembly", "tracking", "refinement")


@dataclass(frozen=True)
class ChildKind:
    """Ranges (minimum, maximum) from which a take is drawn; lengths in m."""

    child: tuple[float, float] = (0.95, 1.25)  # statures
    adult: tuple[float, float] = (1.5, 1.95)
    away: tuple[float, float] = (0.4, 0.6)  # distance of adults from the middle
    cameras: tuple[int, int] = (4, 8)
    radius: tuple[float, float] = (2.8, 4.0)
    low: tuple[float, float] = (0.7, 1.6)  # height of the lowest camera
    high: tuple[float, float] = (1.8, 3.2)
    focal: tuple[float, float] = (0.6, 0.9)  # relative to the image width
    rate: tuple[float, float] = (15.0, 30.0)  # Hz
    seconds: tuple[float, float] = (4.0, 4.6)


USUAL = ChildKind()
HARD = replace(USUAL, child=(0.9, 1.1), away=(0.35, 0.5), cameras=(4, 6))
KINDS = {"usual": USUAL, "hard": HARD}


@dataclass(frozen=True)
class Huddle:
    """Degree of crouching (T,), 0 to 1: in pulses, and in an interval in which all persons crouch."""

    pulses: Pulses
    begin: float  # s
    end: float

    def __call__(self, t: Array) -> Array:
        """Return the degree at times (T,) s."""
        together = ease((t - self.begin) / GOING) * ease((self.end - t) / GOING)
        down: Array = np.maximum(together, self.pulses(t))
        return down


@dataclass(frozen=True)
class BendMotion:
    """Motion that bends the trunk forward; the feet stay in place."""

    standing: StandMotion
    down: Callable[[Array], Array]

    def __call__(self, t: Array, body: BodyLengths) -> LowerBody:
        """Return legs and trunk at times (T,) s."""
        upright, down = self.standing(t, body), self.down(t)
        back = np.stack([np.cos(upright.heading), np.sin(upright.heading), np.zeros(len(t))], axis=1)
        pelvis = upright.pelvis - BACK * down[:, None] * back
        return replace(upright, pelvis=pelvis, lean=upright.lean + BENT * down)


def child_take(seed: int, kind: ChildKind = USUAL) -> Simulation:
    """Draw a take of this kind from a seed."""
    rng = np.random.default_rng([seed, 83])
    rate, size = float(rng.uniform(*kind.rate)), IMAGES[int(rng.integers(len(IMAGES)))]
    radius = float(rng.uniform(*kind.radius))
    focal = min(float(rng.uniform(*kind.focal)) * size[0], size[1] * radius / TALLEST)
    heights = float(rng.uniform(*kind.low)), float(rng.uniform(*kind.high))
    rig = Ring(
        int(rng.integers(kind.cameras[0], kind.cameras[1] + 1)),
        radius,
        heights,
        look_at=float(rng.uniform(0.6, 0.9)),
        lens=Lens(size, (0.95 * focal, focal), distorted_every=2),
    )
    phase = float(rng.choice([0.0, rng.uniform(0.0, 0.5)])) / rate
    doings = ("stand", *(DOINGS[int(k)] for k in rng.integers(len(DOINGS), size=ADULTS)))
    seconds = float(rng.uniform(*kind.seconds))
    what = SimulatedScene(
        "a child whom adults hide",
        doings,
        rig,
        staging="among",
        rendered=True,
        timing=Timing(rate=rate, phase=phase),
        frames=round(rate * seconds),
    )
    people = tuple(_draw_people(rng, kind, doings))
    return replace(simulate(replace(what, activities=("stand",) * len(doings)), seed), people=people)


def _draw_people(
    rng: np.random.Generator, kind: ChildKind, doings: tuple[str, ...]
) -> Iterator[SimulatedPerson]:
    """Draw the child and the adults, who face it."""
    start, begin = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(1.0, 1.6)
    end = begin + rng.uniform(1.5, 2.5)
    middle = rng.normal(0.0, 0.1, 2)
    for number, doing in enumerate(doings):
        angle = start + 2.0 * np.pi * (number + rng.uniform(-0.12, 0.12)) / ADULTS
        away = 0.0 if number == CHILD else rng.uniform(*kind.away)
        x, y = middle + away * np.array([np.cos(angle), np.sin(angle)])
        standing = StandMotion((float(x), float(y)), float(angle + np.pi), draw_sway(rng))
        down = Huddle(
            Pulses.draw(rng, 3.0, 4.5),
            float(begin + rng.uniform(-0.3, 0.3)),
            float(end + rng.uniform(-0.3, 0.3)),
        )
        motion: Motion = standing
        if doing == "crouch":
            motion = replace(standing, crouch=down)
        elif doing == "bend":
            motion = BendMotion(standing, down)
        tall = rng.uniform(*(kind.child if number == CHILD else kind.adult))
        gesture = draw_gesture(rng, str(rng.choice(["reach", "talk"])) if doing == "stand" else "reach")
        yield SimulatedPerson(number, BodyLengths.draw(rng, tall), motion, gesture)


def images_of(take: Simulation) -> Iterator[list[ViewFrame]]:
    """Yield the rendered images of each set of a take, each at the exposure time of its camera."""
    studio, schedule = Studio(take), take.schedule
    rendering = []
    for k, name in enumerate(take.rig.names):
        times = schedule.exposures[:, k]
        rendering.append(studio.camera(name).render(times[np.isfinite(times)]))
    for index in range(len(schedule.ticks)):
        frames = []
        for k, name in enumerate(take.rig.names):
            stamp = schedule.stamps[index, k]
            if np.isfinite(stamp):
                image = next(rendering[k]).image
                frames.append(ViewFrame(name, take.stamp_ns(k, stamp), index, image))
        yield frames


@dataclass(frozen=True)
class ChildInstant:
    """State of the child at one time step of a take.

    Args:
        seconds: True time, s.
        number: Id of the child; None = lost.
        gap: Mean distance of its joints from the truth, m; NaN = lost.
        shown: Number of views with a 2D pose of it.
        loser: Stage that lost it; "" = none.
        ghosts: Number of skeletons without a person.
        others: Ids of the adults by their index.
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
    """Solve the 2D poses of a take, and search for the child after every stage."""
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
    """Return the index (D,) of the person that each 2D pose of a view shows; -1 = none.

    Args:
        truth: true joints (P, J, 3) m, world frame.
    """
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
    """Return whether the child has at least half of the 2D poses in some group.

    Args:
        shows: result of `shown_people` for each view of the set.
    """
    evidence = item.evidence
    whom = np.array([shows[evidence.slots[v]][row] for v, row in zip(evidence.view, evidence.rows)], int)
    for member in item.groups.member:
        own = member[member >= 0]
        if len(own) and 2 * np.count_nonzero(whom[own] == CHILD) >= len(own):
            return True
    return False


def child_figures(instants: Sequence[ChildInstant]) -> dict[str, Any]:
    """Summarise the time steps after the first second: time for which the child was lost, ids, stages."""
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
        parser.add_argument(
            "--kind", choices=tuple(KINDS), default="usual", help="kind of the takes; default usual"
        )
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
