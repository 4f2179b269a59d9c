"""Arrangements of people: at random, spread out, crossing, entering and leaving, round a table, ..."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.errors import ContractError
from panoptic_ros.simulation.body import BodyLengths
from panoptic_ros.simulation.gestures import draw_gesture
from panoptic_ros.simulation.motions import Motion, SitMotion, StandMotion, StepMotion
from panoptic_ros.simulation.paths import ReturnPath, RoundPath, StationaryPath, StraightPath
from panoptic_ros.simulation.people import (
    ACTIVITIES,
    SimulatedPerson,
    draw_group,
    draw_person,
    draw_sway,
    keep_apart,
)
from panoptic_ros.simulation.smooth import Pulses

Array = np.ndarray
OWN_SPACE = 0.6  # m; radius of one person's own space in a spread-out staging


@dataclass(frozen=True)
class StagingArea:
    """Parameters of a staging; lengths in m."""

    activities: tuple[str, ...]  # one per person
    area: float  # radius of the space that people use
    table: float  # radius of the table, 0 = none


def at_random(rng: np.random.Generator, stage: StagingArea) -> list[SimulatedPerson]:
    """Place people anywhere in the area, at a distance from each other."""
    return draw_group(rng, stage.activities, stage.area)


def spread(rng: np.random.Generator, stage: StagingArea) -> list[SimulatedPerson]:
    """Place each person in its own space on a circle of half the area's radius."""
    count = len(stage.activities)
    start, away = rng.uniform(0.0, 2.0 * np.pi), (0.5 * stage.area if count > 1 else 0.0)
    people = []
    for number, activity in enumerate(stage.activities):
        person = draw_person(rng, number, activity, rng.uniform(1.55, 1.90), OWN_SPACE)
        angle = start + 2.0 * np.pi * number / count
        shift = away * np.array([np.cos(angle), np.sin(angle)])
        people.append(replace(person, motion=_moved(person.motion, shift)))
    return people


def in_rooms(rng: np.random.Generator, stage: StagingArea) -> list[SimulatedPerson]:
    """Place one person in each quarter of the area, anywhere in its own space."""
    people = []
    for number, activity in enumerate(stage.activities):
        person = draw_person(rng, number, activity, rng.uniform(1.55, 1.90), OWN_SPACE)
        angle = 0.5 * np.pi * (number + 0.5)
        shift = 0.7 * stage.area * np.array([np.cos(angle), np.sin(angle)])
        people.append(replace(person, motion=_moved(person.motion, shift)))
    return people


def crossing(rng: np.random.Generator, stage: StagingArea) -> list[SimulatedPerson]:
    """Place two people on neighbouring circles so that they meet head-on, 0.5 m apart, at t = 1.5 s."""
    radius, stride, cadence, gap, meeting = 1.2, 1.05, 0.9, 0.5, 1.5
    tilt = rng.uniform(0.0, 2.0 * np.pi)
    people = []
    for number, side in enumerate((0.0, np.pi)):
        away = radius + 0.5 * gap
        centre = (away * np.cos(tilt + side), away * np.sin(tilt + side))
        turn = stride / radius
        start = tilt + side + np.pi - turn * cadence * meeting
        body = BodyLengths.draw(rng, rng.uniform(1.6, 1.9))
        walk = StepMotion(RoundPath(centre, radius, start, turn), cadence)
        people.append(SimulatedPerson(number, body, walk, draw_gesture(rng, "swing")))
    return people


def embrace(rng: np.random.Generator, stage: StagingArea) -> list[SimulatedPerson]:
    """Let two people walk up to each other, embrace, and part."""
    tilt, people = rng.uniform(0.0, 2.0 * np.pi), []
    for number, side in enumerate((0.0, np.pi)):
        toward = np.array([np.cos(tilt + side), np.sin(tilt + side)])
        goal = -0.5 * rng.uniform(0.26, 0.32) * toward
        way = ReturnPath(
            (float(goal[0]), float(goal[1])), tilt + side, rng.uniform(0.6, 0.9), (1.0, 1.1, 1.2)
        )
        walk = StepMotion(way, 0.9, lift=0.05)
        body = BodyLengths.draw(rng, rng.uniform(1.6, 1.9))
        people.append(SimulatedPerson(number, body, walk, draw_gesture(rng, "embrace")))
    return people


def enter_leave(rng: np.random.Generator, stage: StagingArea) -> list[SimulatedPerson]:
    """Let three people walk through the area one after another while a fourth stays."""
    visits = ((0.6, np.inf), (-np.inf, 1.9), (1.2, 3.6))  # s; (from, until) of each visit
    standing = StandMotion((0.0, 0.0), rng.uniform(0.0, 2.0 * np.pi), draw_sway(rng))
    stays = SimulatedPerson(len(visits), BodyLengths.draw(rng, 1.7), standing, draw_gesture(rng, "talk"))
    people: list[SimulatedPerson] = []
    for number, visit in enumerate(visits):

        def make(number: int = number, visit: tuple[float, float] = visit) -> SimulatedPerson:
            return visitor(rng, number, visit, stage.area)

        people.append(keep_apart(make, [stays, *people], gap=0.55))
    return [*people, stays]


def round_table(rng: np.random.Generator, stage: StagingArea) -> list[SimulatedPerson]:
    """Place people on chairs around the table, facing it; the fifth is a child."""
    count = len(stage.activities)
    people = []
    for number in range(count):
        angle = 2.0 * np.pi * (number + rng.uniform(-0.12, 0.12)) / count
        away = stage.table + rng.uniform(0.22, 0.32)
        tall = rng.uniform(1.2, 1.35) if number == 4 else rng.uniform(1.55, 1.95)
        motion = SitMotion(
            (away * np.cos(angle), away * np.sin(angle)),
            angle + np.pi + rng.normal(0.0, 0.1),
            draw_sway(rng),
            Pulses.draw(rng, 3.0, 6.0),
        )
        people.append(
            SimulatedPerson(number, BodyLengths.draw(rng, tall), motion, draw_gesture(rng, "table"))
        )
    return people


def among(rng: np.random.Generator, stage: StagingArea) -> list[SimulatedPerson]:
    """Place a child in the middle and the others half a metre around it, facing it and crouching."""
    people = []
    start, others = rng.uniform(0.0, 2.0 * np.pi), len(stage.activities) - 1
    for number, activity in enumerate(stage.activities):
        angle = start + 2.0 * np.pi * (number + rng.uniform(-0.1, 0.1)) / others
        away = rng.uniform(0.5, 0.6) if number else 0.0
        place = (float(away * np.cos(angle)), float(away * np.sin(angle)))
        tall = rng.uniform(1.6, 1.9) if number else rng.uniform(1.05, 1.2)
        down = Pulses.draw(rng, 3.0, 4.5) if activity == "crouch" else None
        motion = StandMotion(place, angle + np.pi, draw_sway(rng), crouch=down)
        people.append(
            SimulatedPerson(
                number, BodyLengths.draw(rng, tall), motion, draw_gesture(rng, ACTIVITIES[activity])
            )
        )
    return people


def with_bystanders(rng: np.random.Generator, stage: StagingArea) -> list[SimulatedPerson]:
    """Place people at random, and three bystanders, who are not part of the task, behind the cameras."""
    people = draw_group(rng, stage.activities, stage.area)
    start = rng.uniform(0.0, 2.0 * np.pi)
    for k, activity in enumerate(("talk", "turn", "reach")):
        person = draw_person(rng, len(people), activity, rng.uniform(1.6, 1.9), 0.1)
        angle = start + 2.0 * np.pi * (k + rng.uniform(-0.2, 0.2)) / 3.0
        shift = rng.uniform(6.5, 8.0) * np.array([np.cos(angle), np.sin(angle)])
        people.append(replace(person, motion=_moved(person.motion, shift), bystander=True))
    return people


Staging = Callable[[np.random.Generator, StagingArea], list[SimulatedPerson]]
STAGINGS: dict[str, Staging] = {
    "random": at_random,
    "spread": spread,
    "rooms": in_rooms,
    "crossing": crossing,
    "embrace": embrace,
    "enter-leave": enter_leave,
    "table": round_table,
    "among": among,
    "bystanders": with_bystanders,
}


def visitor(rng: np.random.Generator, number: int, visit: Sequence[float], area: float) -> SimulatedPerson:
    """Return a person who walks straight through the area and is present during `visit` (from, until; s)."""
    stride, cadence = 1.0, 0.9
    enter, leave = visit
    duration = 2.0 * area / (stride * cadence)
    begin = enter if np.isfinite(enter) else leave - duration
    heading = float(rng.uniform(0.0, 2.0 * np.pi))
    forward = np.array([np.cos(heading), np.sin(heading)])
    aside = rng.choice([-1.0, 1.0]) * rng.uniform(0.6, 1.1) * np.array([-forward[1], forward[0]])
    start = aside - (area + stride * cadence * begin) * forward
    walk = StepMotion(StraightPath((float(start[0]), float(start[1])), heading, stride), cadence)
    body = BodyLengths.draw(rng, rng.uniform(1.55, 1.95))
    return SimulatedPerson(
        number, body, walk, draw_gesture(rng, "swing"), (enter, min(leave, begin + duration))
    )


def _moved(motion: Motion, shift: Array) -> Motion:
    """Return the same motion shifted by `shift` (2,) m."""
    if isinstance(motion, StepMotion) and isinstance(motion.path, (StationaryPath, RoundPath)):
        x, y = np.array(motion.path.centre) + shift
        return replace(motion, path=replace(motion.path, centre=(float(x), float(y))))
    if not isinstance(motion, (StandMotion, SitMotion)):
        raise ContractError(f"{motion} has no place that can be moved")
    x, y = np.array(motion.place) + shift
    return replace(motion, place=(float(x), float(y)))
