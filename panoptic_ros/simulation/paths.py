"""Walking paths: positions on the floor and headings as functions of gait cycles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from panoptic_ros.simulation.smooth import ease

Array = np.ndarray
Path = Callable[[Array], tuple[Array, Array]]  # cycles (T,) -> positions (T, 2) m, headings (T,) rad


@dataclass(frozen=True)
class StraightPath:
    """Straight path from `start` (m, at cycle 0)."""

    start: tuple[float, float]
    heading: float  # rad
    stride: float  # m per cycle

    def __call__(self, cycles: Array) -> tuple[Array, Array]:
        forward = np.array([np.cos(self.heading), np.sin(self.heading)])
        ground = np.array(self.start) + self.stride * cycles[:, None] * forward
        return ground, np.full(cycles.shape, self.heading)


@dataclass(frozen=True)
class ReturnPath:
    """Straight path to a goal, a stay, and the same way backwards.

    Steps continue during the stay.
    """

    goal: tuple[float, float]  # m
    heading: float  # rad
    length: float  # m; length of the path
    cycles: tuple[float, float, float]  # gait cycles on the way, at the goal, and on the way back

    def __call__(self, cycles: Array) -> tuple[Array, Array]:
        there, stay, back = self.cycles
        left = 1.0 - ease(cycles / there) + ease((cycles - there - stay) / back)
        forward = np.array([np.cos(self.heading), np.sin(self.heading)])
        ground = np.array(self.goal) - self.length * left[:, None] * forward
        return ground, np.full(cycles.shape, self.heading)


@dataclass(frozen=True)
class RoundPath:
    """Closed path around a centre: a circle with radial variations of two and three lobes."""

    centre: tuple[float, float]  # m
    radius: float  # m
    start: float  # rad, at cycle 0
    turn: float  # rad per cycle; negative = clockwise
    dents: tuple[float, float] = (0.0, 0.0)  # relative depth of two and three lobes
    shifts: tuple[float, float] = (0.0, 0.0)  # rad; phases of the lobes

    def __call__(self, cycles: Array) -> tuple[Array, Array]:
        angle = self.start + self.turn * cycles
        radius, slope = np.ones_like(angle), np.zeros_like(angle)
        for lobes, dent, shift in zip((2, 3), self.dents, self.shifts):
            radius = radius + dent * np.cos(lobes * angle + shift)
            slope = slope - lobes * dent * np.sin(lobes * angle + shift)
        outward = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        along = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
        ground = np.array(self.centre) + self.radius * radius[:, None] * outward
        velocity = np.sign(self.turn) * (slope[:, None] * outward + radius[:, None] * along)
        return ground, np.arctan2(velocity[:, 1], velocity[:, 0])


@dataclass(frozen=True)
class StationaryPath:
    """Turning on the spot."""

    centre: tuple[float, float]  # m
    start: float  # rad
    turn: float  # rad per cycle

    def __call__(self, cycles: Array) -> tuple[Array, Array]:
        return np.tile(np.array(self.centre), (len(cycles), 1)), self.start + self.turn * cycles
