"""The study `identity`: persons who are hidden, cross, come and go, or are seen by few views.

The study also measures how often a bystander takes the id of a designated person, one of five who come and
go. A last part adds the colours of clothes to bone lengths and positions. Its images are small and rendered
at every third time step, which is enough for colours. Its 2D poses come from a simulated detector with
misses, errors and merged persons.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from panoptic_ros.domain import DetectionSet, ViewAppearance, ViewFrame
from panoptic_ros.graph.build import configure, make_stage, merged
from panoptic_ros.identity.subjects import subject_word
from panoptic_ros.running.arguments import within
from panoptic_ros.running.plans.parameters import read_parameters
from panoptic_ros.simulation import Absence, SimulatedScene, Simulation, simulate
from panoptic_ros.simulation.people import SimulatedPerson
from panoptic_ros.simulation.rendering import Studio
from panoptic_ros.simulation.rigs import Lens, Ring
from panoptic_ros.simulation.skeleton import SKELETON
from panoptic_ros.stage import Progress, StageContext, untold
from panoptic_ros.study.options import add_seeds, add_settings
from panoptic_ros.study.people.identity import (
    AWAY,
    NO_SETTINGS,
    VISITS_S,
    Instant,
    Settings,
    few_views,
    follow,
    trials,
    visit_figures,
    visits,
    visits_scene,
)
from panoptic_ros.study.study import Case, Result, Row, Study

TRIALS_PER_TAKE = 10  # ratio of trials to takes of the other scenes, which are longer
# s, length of a take with a designated person. Half as many of these takes are made as of the other takes.
DESIGNATED_S = 60.0
# relative cost by part
PARTS = {"trials": 4.0, "few views": 2.0, "visits": 1.0, "designated": 1.0, "dressed": 2.0}
SUBJECT = 100  # id of the designated person
SMALL = Ring(5, radius=3.9, heights=(1.2, 2.6), lens=Lens((320, 240), (212.0, 220.0), distorted_every=0))
Array = np.ndarray
EVERY = 3  # one image per this number of time steps
Looks = Mapping[int, Sequence[ViewAppearance]]


def dressed_scene(seed: int, seconds: float) -> SimulatedScene:
    """Return the scene of persons who come and go, with cameras whose images are rendered."""
    return replace(visits_scene(seed, seconds), rig=SMALL, rendered=True)


@dataclass(frozen=True)
class Visitor(SimulatedPerson):
    """Person who is not in the images during absences."""

    absences: tuple[Absence, ...] = ()

    def is_present(self, t: Array) -> Array:
        """Return whether the person is present at times t (T,)."""
        there = SimulatedPerson.is_present(self, t)
        for absence in self.absences:
            there = there & ~((t >= absence.start) & (t < absence.end))
        return there


def visitors(take: Simulation) -> Simulation:
    """Return the take with persons who are not in the images during their absences."""
    return replace(
        take,
        people=tuple(
            Visitor(
                person.id,
                person.body,
                person.motion,
                person.gesture,
                person.present,
                person.bystander,
                tuple(absence for absence in take.scene.absences if absence.person == person.id),
            )
            for person in take.people
        ),
    )


def looks_of(take: Simulation, sets: Sequence[DetectionSet]) -> Looks:
    """Return the appearance of clothes in all cameras, by index of the set."""
    studio, numbers = Studio(visitors(take)), np.arange(0, len(sets), EVERY)
    stage = make_stage("appearance", configure({})["appearance"], StageContext(take.rig, SKELETON))
    found: dict[int, list[ViewAppearance]] = {}
    for camera in take.rig.names:
        images = studio.camera(camera).render(take.schedule.ticks[numbers])
        for number, rendered in zip(numbers.tolist(), images):
            for view in (view for view in sets[number].views if view.camera == camera):
                stage.step(ViewFrame(camera, view.stamp_ns, view.frame_number, rendered.image))
                found.setdefault(number, []).extend(stage.step(view).outputs)
    return found


def dressed_visits(seed: int, seconds: float, settings: Settings = NO_SETTINGS) -> dict[str, Any]:
    """Return the id figures of five persons who come and go, without and with appearance.

    Without appearance, re-identification uses bone lengths and positions alone.
    """
    what, rows = dressed_scene(seed, seconds), {}
    for name, seen in (("bones", None), ("appearance", looks_of)):
        own = {"tracking": {"memory": AWAY[1], "appearance": seen is not None}}
        rows[name] = visit_figures(follow(what, seed, merged(own, settings), seen))
    return {"seconds": seconds, **rows}


def designated_figures(instants: Sequence[Instant], person: int) -> dict[str, int]:
    """Count the time steps with the subject present, found, and with a bystander under its id."""
    there = [now for now in instants if person in now.there]
    return {
        "there": len(there),
        "followed": sum(person in now.found and now.found[person].number == SUBJECT for now in there),
        "taken": sum(
            any(match.number == SUBJECT for other, match in now.found.items() if other != person)
            for now in instants
        ),
    }


def designated(
    takes: int,
    seed: int,
    settings: Settings = NO_SETTINGS,
    seconds: float = VISITS_S,
    progress: Progress = untold,
) -> dict[str, Any]:
    """Return the sums of `designated_figures` over several takes.

    The subject is designated by its position at the beginning.
    """
    total = {"there": 0, "followed": 0, "taken": 0}
    for k in range(takes):
        progress(k / takes, "a designated person")
        what = visits_scene(seed + k, seconds)
        take = simulate(what, seed + k)
        first = take.schedule.ticks[:1]
        person = next(own for own in take.people if own.is_present(first).all())
        place = person.joints(first)[0][SKELETON.joint("BodyCenter")]
        told = {"tracking": {"memory": AWAY[1], "subjects": (subject_word(SUBJECT, place),)}}
        found = designated_figures(follow(what, seed + k, merged(told, settings)), person.id)
        total = {name: total[name] + found[name] for name in total}
    progress(1.0, "a designated person")
    return {"takes": takes, "seconds": seconds, **total}


class Identity(Study):
    """Trials of each kind; a tenth of it of few views; 6 s of visits for each trial, 3 s of other visits.

    With --trials N, there are N trials per event, N / 10 takes with few views and N / 20 takes with a
    designated person. Persons come and go for 6 N s, and those in different clothes for 3 N s.
    """

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        parser.add_argument(
            "--trials",
            type=within(int, 1, 10**6),
            default=100,
            metavar="N",
            help="number of trials of each kind, with seeds from the first one on; default 100",
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
