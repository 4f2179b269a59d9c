"""Simulated worlds for any number of persons and views, with the simulator's own identities."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.domain import Rig
from panoptic_ros.errors import UsageError
from panoptic_ros.simulation import (
    NOISY,
    SKELETON,
    Corners,
    Dome,
    PanelDome,
    Ring,
    SimulatedScene,
    Simulation,
    farthest_first,
    simulate,
)
from panoptic_ros.simulation.drawn_maps import MapDrawing, with_drawn_maps
from panoptic_ros.simulation.rigs import RigPlan
from panoptic_ros.study.world import HD_MAPS, VGA_MAPS, World, truth_of

Array = np.ndarray
ACTIVITIES = ("walk", "walk", "talk", "reach", "turn", "crouch", "wave", "sit-down")


@dataclass(frozen=True)
class Layout:
    """Rig plan, radius (m) of the area of the persons, working volume (m), and size of the score maps."""

    rig: RigPlan
    area: float
    bounds: tuple[float, ...]
    maps: MapDrawing


def layout_of(views: int, people: int) -> Layout:
    """Return a room's corners, a ring, a dome of HD cameras, or the cameras of a studio's panels.

    Raises:
        UsageError: for fewer than two views or more than 480.
    """
    if not 2 <= views <= 480:
        raise UsageError(f"{views} views: the study has rigs of 2 to 480")
    small, large = (-2.56, -2.56, 0.0, 2.56, 2.56, 2.56), (-3.2, -3.2, 0.0, 3.2, 3.2, 2.56)
    if views <= 3:
        return Layout(Corners(views), 1.9, large, HD_MAPS)
    if views <= 16:
        crowded = people > 4
        return Layout(Ring(views, radius=4.6 if crowded else 4.2), 2.7 if crowded else 2.3, large, HD_MAPS)
    if views <= 48:
        return Layout(Dome(views), 1.8, small, HD_MAPS)
    return Layout(Spread(views), 1.6, small, VGA_MAPS)


@dataclass(frozen=True)
class Spread:
    """VGA cameras of the studio's 480, each the farthest from all before it."""

    cameras: int

    def build(self, rng: np.random.Generator) -> Rig:
        """Return the rig of these cameras."""
        return farthest_first(PanelDome(24).build(rng), self.cameras)


def make_world(people: int, views: int, frames: int, seed: int, maps: bool) -> World:
    """Simulate a take with a noisy detector."""
    layout = layout_of(views, people)
    faults = NOISY if views <= 48 else replace(NOISY, noise_px=1.0, size_px=250.0, outlier_px=20.0)
    activities = tuple(np.resize(ACTIVITIES, people).tolist())
    scene = SimulatedScene("bench", activities, layout.rig, area=layout.area, degradation=faults)
    take = simulate(scene, seed, frames)
    sets = tuple(take.detection_sets())
    if maps:
        sets = tuple(with_drawn_maps(item, layout.maps) for item in sets)
    return World(take.rig, SKELETON, sets, layout.bounds, truth_of(take), tuple(_given(take, frames)))


def _given(take: Simulation, frames: int) -> list[tuple[Array, Array]]:
    """Return pixels (P, J, C, 2) and scores (P, J, C) of all frames; see `World.given`."""
    rows = []
    for _, views in take.sightings():
        pixels = np.full((len(take.people), len(SKELETON), len(take.rig), 2), np.nan)
        scores = np.zeros(pixels.shape[:3])
        for c, view in enumerate(views):
            q, j = np.nonzero((view.sources[..., 0] >= 0) & (view.scores > 0.0))
            person, joint = view.sources[q, j].T
            pixels[person, joint, c], scores[person, joint, c] = view.points[q, j], view.scores[q, j]
        rows.append((pixels, scores))
    return rows[:frames]
