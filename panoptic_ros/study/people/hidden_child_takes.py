"""Rendered takes of a child whom adults hide: bodies, doings, cameras and timing are drawn from the seed.

A child stands in the middle of three adults. They stand, crouch, bend or reach, and for a while all at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.domain import ViewFrame
from panoptic_ros.simulation import Scene, Simulation, simulate
from panoptic_ros.simulation.body import Body, LowerBody
from panoptic_ros.simulation.gestures import draw_gesture
from panoptic_ros.simulation.motions import Motion, Standing
from panoptic_ros.simulation.people import Person, draw_sway
from panoptic_ros.simulation.rendering import Studio
from panoptic_ros.simulation.rigs import Lens, Ring
from panoptic_ros.simulation.smooth import Pulses, ease
from panoptic_ros.simulation.timing import Timing

Array = np.ndarray
CHILD, ADULTS = 0, 3  # number of the child, and how many adults
DOINGS = ("stand", "crouch", "bend", "reach")
IMAGES = ((640, 480), (640, 360), (800, 600), (512, 384))  # px
GOING = 0.5  # s, to go down or up
BENT, BACK = 0.9, 0.12  # rad, lean of who bends; m, the hips go back meanwhile
TALLEST = 2.2  # m, that an image shows at the distance of the middle, at least


@dataclass(frozen=True)
class ChildKind:
    """From what takes are drawn: ranges (least, most), lengths in m."""

    child: tuple[float, float] = (0.95, 1.25)  # statures
    adult: tuple[float, float] = (1.5, 1.95)
    away: tuple[float, float] = (0.4, 0.6)  # adults from the middle
    cameras: tuple[int, int] = (4, 8)
    radius: tuple[float, float] = (2.8, 4.0)
    low: tuple[float, float] = (0.7, 1.6)  # height of the lowest camera
    high: tuple[float, float] = (1.8, 3.2)
    focal: tuple[float, float] = (0.6, 0.9)  # of the width of the image
    rate: tuple[float, float] = (15.0, 30.0)  # Hz
    seconds: tuple[float, float] = (4.0, 4.6)


USUAL = ChildKind()
HARD = replace(USUAL, child=(0.9, 1.1), away=(0.35, 0.5), cameras=(4, 6))
KINDS = {"usual": USUAL, "hard": HARD}


@dataclass(frozen=True)
class Huddle:
    """Degree of crouching (T,), 0 to 1: in pulses, and in one interval together with the others."""

    pulses: Pulses
    begin: float  # s
    end: float

    def __call__(self, t: Array) -> Array:
        """At times (T,) s."""
        together = ease((t - self.begin) / GOING) * ease((self.end - t) / GOING)
        down: Array = np.maximum(together, self.pulses(t))
        return down


@dataclass(frozen=True)
class Bending:
    """Bend the trunk forwards; the feet stay."""

    standing: Standing
    down: Callable[[Array], Array]

    def __call__(self, t: Array, body: Body) -> LowerBody:
        """Legs and trunk at times (T,) s."""
        upright, down = self.standing(t, body), self.down(t)
        back = np.stack([np.cos(upright.heading), np.sin(upright.heading), np.zeros(len(t))], axis=1)
        pelvis = upright.pelvis - BACK * down[:, None] * back
        return replace(upright, pelvis=pelvis, lean=upright.lean + BENT * down)


def child_take(seed: int, kind: ChildKind = USUAL) -> Simulation:
    """Draw a take of the kind from a seed."""
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
    what = Scene(
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


def _draw_people(rng: np.random.Generator, kind: ChildKind, doings: tuple[str, ...]) -> Iterator[Person]:
    """Draw the child and the adults, who face it."""
    start, begin = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(1.0, 1.6)
    end = begin + rng.uniform(1.5, 2.5)
    middle = rng.normal(0.0, 0.1, 2)
    for number, doing in enumerate(doings):
        angle = start + 2.0 * np.pi * (number + rng.uniform(-0.12, 0.12)) / ADULTS
        away = 0.0 if number == CHILD else rng.uniform(*kind.away)
        x, y = middle + away * np.array([np.cos(angle), np.sin(angle)])
        standing = Standing((float(x), float(y)), float(angle + np.pi), draw_sway(rng))
        down = Huddle(
            Pulses.draw(rng, 3.0, 4.5),
            float(begin + rng.uniform(-0.3, 0.3)),
            float(end + rng.uniform(-0.3, 0.3)),
        )
        motion: Motion = standing
        if doing == "crouch":
            motion = replace(standing, crouch=down)
        elif doing == "bend":
            motion = Bending(standing, down)
        tall = rng.uniform(*(kind.child if number == CHILD else kind.adult))
        gesture = draw_gesture(rng, str(rng.choice(["reach", "talk"])) if doing == "stand" else "reach")
        yield Person(number, Body.draw(rng, tall), motion, gesture)


def images_of(take: Simulation) -> Iterator[list[ViewFrame]]:
    """Render the images of each set of a take, each at the exposure of its camera."""
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
