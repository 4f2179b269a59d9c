"""People in different clothes who come and go: what their colours add to bones and places.

Images are rendered at every third instant and small, as colours need no more; the 2D people are those of a
simulated detector, which misses, mistakes and melts them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from panoptic_ros.domain import DetectionSet, ViewAppearance, ViewFrame
from panoptic_ros.graph.build import configure, make_stage, merged
from panoptic_ros.simulation import Absence, Scene, Simulation
from panoptic_ros.simulation.people import Person
from panoptic_ros.simulation.rendering import Studio
from panoptic_ros.simulation.rigs import Lens, Ring
from panoptic_ros.simulation.skeleton import SKELETON
from panoptic_ros.stage import StageContext
from panoptic_ros.study.people.identity import (
    AWAY,
    NO_SETTINGS,
    Settings,
    follow,
    visit_figures,
    visits_scene,
)

SMALL = Ring(5, radius=3.9, heights=(1.2, 2.6), lens=Lens((320, 240), (212.0, 220.0), distorted_every=0))
Array = np.ndarray
EVERY = 3  # instants, of which one is rendered
Looks = Mapping[int, Sequence[ViewAppearance]]


def dressed_scene(seed: int, seconds: float) -> Scene:
    """Those who come and go, in front of cameras whose images are rendered."""
    return replace(visits_scene(seed, seconds), rig=SMALL, rendered=True)


@dataclass(frozen=True)
class Visitor(Person):
    """Somebody who is not in the images while away."""

    absences: tuple[Absence, ...] = ()

    def is_present(self, t: Array) -> Array:
        """Whether the person is there (T,)."""
        there = Person.is_present(self, t)
        for absence in self.absences:
            there = there & ~((t >= absence.start) & (t < absence.end))
        return there


def visitors(take: Simulation) -> Simulation:
    """The take with people who are not in the images while they are away."""
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
    """What cameras see of clothes, by the number of the instant."""
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
    """What became of the ids of five people who come and go, by bones and place alone and with appearance."""
    what, rows = dressed_scene(seed, seconds), {}
    for name, seen in (("bones", None), ("appearance", looks_of)):
        own = {"tracking": {"memory": AWAY[1], "appearance": seen is not None}}
        rows[name] = visit_figures(follow(what, seed, merged(own, settings), seen))
    return {"seconds": seconds, **rows}
