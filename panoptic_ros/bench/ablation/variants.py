"""Variants of a scene, named behind it: what detectors and rigs do that the scene itself does not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from panoptic_ros.bench.stage1.world import HD_MAPS
from panoptic_ros.domain import DetectionSet, Rig, ScoreMaps, ViewDetections
from panoptic_ros.errors import UsageError
from panoptic_ros.simulation import SCENES, Scene, Simulation
from panoptic_ros.simulation.drawn_maps import with_drawn_maps

Array = np.ndarray
Sets = tuple[DetectionSet, ...]
UNLISTED_PERSON = 0  # whom score maps alone show, as a detector's person head may fail
FEW = 2  # cameras


def split(name: str) -> tuple[Scene, list[str]]:
    """The scene of a name and its variants.

    Raises:
        UsageError: if there is no such scene or variant.
    """
    scene, *variants = name.split("+")
    unknown = [word for word in variants if word not in VARIANTS]
    if scene not in SCENES or unknown or (variants and SCENES[scene].rendered):
        raise UsageError(
            f"there is no scene {name!r}; there are {', '.join(SCENES)}, and behind those that are not "
            f"rendered {', '.join('+' + word for word in VARIANTS)}"
        )
    return SCENES[scene], variants


def varied(take: Simulation, variants: list[str]) -> tuple[Rig, Sets]:
    """The cameras and the 2D people of a take with these variants, in their order."""
    rig, sets = take.rig, tuple(take.detection_sets())
    for word in variants:
        rig, sets = VARIANTS[word](take, rig, sets)
    return rig, sets


def _with_maps(take: Simulation, rig: Rig, sets: Sets) -> tuple[Rig, Sets]:
    """Score maps drawn from the 2D people."""
    return rig, tuple(with_drawn_maps(item, HD_MAPS) for item in sets)


def _with_someone_unlisted(take: Simulation, rig: Rig, sets: Sets) -> tuple[Rig, Sets]:
    """Score maps of everybody; one person is in no list of 2D people."""
    rig, sets = _with_maps(take, rig, sets)
    varied = []
    for item, (_, sightings) in zip(sets, take.sightings()):
        views = [
            _unlisted(view, (sightings[rig.names.index(view.camera)].sources[..., 0] == UNLISTED_PERSON))
            for view in item.views
        ]
        varied.append(replace(item, views=tuple(views)))
    return rig, tuple(varied)


def _unlisted(view: ViewDetections, theirs: Array) -> ViewDetections:
    """The view without the 2D people most of whose joints are `theirs` (Q, J); the maps stay."""
    listed = 2 * theirs.sum(axis=1) <= (view.scores > 0.0).sum(axis=1)
    numbers = np.where(listed, np.cumsum(listed) - 1, -1)
    maps = view.maps
    if isinstance(maps, ScoreMaps):
        maps = replace(maps, persons=numbers[maps.persons])
    return replace(
        view,
        points=view.points[listed],
        scores=view.scores[listed],
        person_scores=view.person_scores[listed],
        maps=maps,
    )


def _with_few_views(take: Simulation, rig: Rig, sets: Sets) -> tuple[Rig, Sets]:
    """Two cameras, the first ones."""
    few = replace(rig, cameras=rig.cameras[:FEW])
    kept = [replace(item, views=tuple(v for v in item.views if v.camera in few.names)) for item in sets]
    return few, tuple(item for item in kept if item.views)


VARIANTS: dict[str, Callable[[Simulation, Rig, Sets], tuple[Rig, Sets]]] = {
    "maps": _with_maps,
    "unlisted": _with_someone_unlisted,
    "2views": _with_few_views,
}
