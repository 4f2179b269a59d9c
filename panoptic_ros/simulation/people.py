"""Simulated people: a body, its motion, and the time of its presence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from panoptic_ros.errors import UsageError
from panoptic_ros.simulation.body import BodyLengths, Posture, assume_posture
from panoptic_ros.simulation.gestures import Gesture, draw_gesture
from panoptic_ros.simulation.motions import Motion, SitMotion, StandMotion, StepMotion
from panoptic_ros.simulation.paths import RoundPath, StationaryPath
from panoptic_ros.simulation.smooth import Pulses, SmoothNoise

Array = np.ndarray

ACTIVITIES = {  # gesture of each activity
    "walk": "swing",
    "run": "swing",
    "stand": "talk",
    "talk": "talk",
    "reach": "reach",
    "wave": "wave",
    "turn": "talk",
    "crouch": "reach",
    "sit-down": "talk",
    "sit": "table",
}
APART_UNTIL = np.arange(0.0, 6.0, 0.1)  # s; times at which distances between people are checked
TRIES = 200  # largest number of people drawn to find one at a sufficient distance


@dataclass(frozen=True)
class SimulatedPerson:
    """Simulated person whose joints are exact at every instant."""

    id: int
    body: BodyLengths
    motion: Motion
    gesture: Gesture
    present: tuple[float, float] = (-np.inf, np.inf)  # s, from and until
    bystander: bool = False  # not part of the task, so a result may contain this person or not

    def posture(self, t: Array) -> Posture:
        """Return joints and rotations at times (T,) s."""
        t = np.asarray(t, np.float64)
        lower = self.motion(t, self.body)
        return assume_posture(self.body, lower, self.gesture(t, lower.steps))

    def joints(self, t: Array) -> Array:
        """Return joints (T, 19, 3) m at times (T,) s."""
        return self.posture(t).joints

    def is_present(self, t: Array) -> Array:
        """Return a mask (T,) of the times at which the person is present."""
        return (t >= self.present[0]) & (t < self.present[1])


def draw_sway(rng: np.random.Generator) -> SmoothNoise:
    """Draw the sway of a person who stays on the spot."""
    return SmoothNoise.draw(rng, [0.014, 0.021, 0.14], 0.1, 0.5)


def draw_person(
    rng: np.random.Generator, number: int, activity: str, height: float, area: float
) -> SimulatedPerson:
    """Draw a person of this height (m) who does `activity` within `area` m of the origin.

    Raises:
        UsageError: If the activity is unknown.
    """
    if activity not in ACTIVITIES:
        raise UsageError(f"unknown activity {activity!r}; there are {', '.join(ACTIVITIES)}")
    body = BodyLengths.draw(rng, height)
    motion = _draw_motion(rng, activity, body, area)
    return SimulatedPerson(number, body, motion, draw_gesture(rng, ACTIVITIES[activity]))


def draw_group(
    rng: np.random.Generator, activities: Sequence[str], area: float, gap: float = 0.75
) -> list[SimulatedPerson]:
    """Draw one person per activity, at least `gap` m apart where possible; every fifth is a child."""
    people: list[SimulatedPerson] = []
    for number, activity in enumerate(activities):
        tall = rng.uniform(1.1, 1.4) if number % 5 == 4 else rng.uniform(1.55, 1.95)

        def make(number: int = number, activity: str = activity, tall: float = tall) -> SimulatedPerson:
            return draw_person(rng, number, activity, tall, area)

        people.append(keep_apart(make, people, gap))
    return people


def keep_apart(
    make: Callable[[], SimulatedPerson],
    others: Sequence[SimulatedPerson],
    gap: float,
    times: Array = APART_UNTIL,
) -> SimulatedPerson:
    """Return the first drawn person who stays `gap` m away from the others, or the best of `TRIES` draws.

    Args:
        times: times (T,) s at which the distances are checked.
    """
    best, best_distance = make(), -1.0
    for attempt in range(TRIES):
        person = best if attempt == 0 else make()
        distance = _closest(person, others, times)
        if distance > best_distance:
            best, best_distance = person, distance
        if distance >= gap:
            break
    return best


def _closest(person: SimulatedPerson, others: Sequence[SimulatedPerson], times: Array) -> float:
    """Return the smallest floor distance (m) between the person and any other at times (T,) s."""
    own = person.motion(times, person.body).pelvis[:, :2]
    tracks = [other.motion(times, other.body).pelvis[:, :2] for other in others]
    return min((float(np.linalg.norm(own - track, axis=1).min()) for track in tracks), default=np.inf)


def _draw_motion(rng: np.random.Generator, activity: str, body: BodyLengths, area: float) -> Motion:
    if activity in ("walk", "run"):
        return _draw_walk(rng, body, area, fast=activity == "run")
    away, angle = area * np.sqrt(rng.uniform(0.0, 1.0)), rng.uniform(0.0, 2.0 * np.pi)
    place = (float(away * np.cos(angle)), float(away * np.sin(angle)))
    heading = float(angle + np.pi + rng.normal(0.0, 0.8))  # mostly towards the origin
    if activity == "turn":
        return StepMotion(StationaryPath(place, heading, rng.uniform(0.7, 1.2)), 0.8, rng.uniform(0, 1), 0.05)
    sway = draw_sway(rng)
    if activity == "sit":
        return SitMotion(place, heading, sway, Pulses.draw(rng, 3.0, 6.0))
    if activity == "crouch":
        return StandMotion(place, heading, sway, crouch=Pulses.draw(rng, 3.0, 4.5))
    if activity == "sit-down":
        return StandMotion(place, heading, sway, sit_at=float(rng.uniform(0.5, 1.2)))
    return StandMotion(place, heading, sway)


def _draw_walk(rng: np.random.Generator, body: BodyLengths, area: float, fast: bool) -> StepMotion:
    """Draw a walk or run on a closed path within `area` m of the origin."""
    radius = float(rng.uniform(0.55 if fast else 0.27, 0.62) * area)
    away, angle = rng.uniform(0.0, max(area - 1.1 * radius, 0.0)), rng.uniform(0.0, 2.0 * np.pi)
    stride = min((0.80 if fast else 0.62) * body.height, 0.9 * radius)
    path = RoundPath(
        (float(away * np.cos(angle)), float(away * np.sin(angle))),
        radius,
        start=float(rng.uniform(0.0, 2.0 * np.pi)),
        turn=float(rng.choice([-1.0, 1.0])) * stride / radius,
        dents=(float(rng.uniform(0.0, 0.12)), float(rng.uniform(0.0, 0.06))),
        shifts=(float(rng.uniform(0.0, 2.0 * np.pi)), float(rng.uniform(0.0, 2.0 * np.pi))),
    )
    cadence = rng.uniform(1.3, 1.5) if fast else rng.uniform(0.70, 0.92)
    return StepMotion(path, float(cadence), start=float(rng.uniform(0.0, 1.0)))
