"""Motions of legs and trunk: stepping along a path, standing, sitting.

Times are (T,) s.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from panoptic_ros.simulation.body import BodyLengths, LowerBody, axes_of
from panoptic_ros.simulation.paths import Path
from panoptic_ros.simulation.skeleton import SIDES
from panoptic_ros.simulation.smooth import Pulses, SmoothNoise, ease

Array = np.ndarray
Motion = Callable[[Array, BodyLengths], LowerBody]
STANCE = 0.58  # share of a gait cycle in which a foot is on the floor
SITTING_DOWN = 1.4  # s; duration of sitting down


@dataclass(frozen=True)
class StepMotion:
    """Walking, running or turning along a path; a foot does not move while it is on the floor."""

    path: Path
    cadence: float  # gait cycles per second
    start: float = 0.0  # gait cycles at t = 0
    lift: float = 0.09  # m; peak height of the swinging foot

    def __call__(self, t: Array, body: BodyLengths) -> LowerBody:
        # a small variation, because people do not keep an exact cadence
        steps = self.start + self.cadence * t + 0.02 * np.sin(0.9 * t)
        ground, heading = self.path(steps)
        height = body.ankle + 0.945 * body.leg - 0.012 * np.cos(4.0 * np.pi * steps)
        ankles = np.stack([self._ankle(steps, body, k) for k in range(2)], axis=1)
        pelvis = np.column_stack([ground, height])
        return LowerBody(pelvis, heading, np.full_like(t, 0.05), ankles, steps)

    def _ankle(self, steps: Array, body: BodyLengths, k: int) -> Array:
        """Return the ankle (T, 3) m of the left leg (k = 0) or the right leg, which is half a cycle later."""
        late = 0.5 * k
        cycle = np.floor(steps + late)
        swing = np.maximum(steps + late - cycle - STANCE, 0.0) / (1.0 - STANCE)
        stance = cycle - late + 0.5 * STANCE  # gait cycles at which the pelvis passes the planted foot
        before, after = (self._footprint(stance + n, body, k) for n in (0.0, 1.0))
        ground = before + ease(swing)[:, None] * (after - before)
        return np.column_stack([ground, body.ankle + self.lift * (4.0 * swing * (1.0 - swing)) ** 3])

    def _footprint(self, steps: Array, body: BodyLengths, k: int) -> Array:
        ground, heading = self.path(steps)
        left = np.stack([-np.sin(heading), np.cos(heading)], axis=-1)
        return ground + SIDES[k][1] * body.hip * left


@dataclass(frozen=True)
class StandMotion:
    """Standing and swaying on both feet, with optional crouching at intervals or sitting down once."""

    place: tuple[float, float]  # m; point between the feet
    heading: float  # rad
    sway: SmoothNoise  # forward m, sideways m, turn rad
    crouch: Callable[[Array], Array] | None = None  # crouch depth, 0 to 1, at times (T,) s
    sit_at: float | None = None  # s

    def __call__(self, t: Array, body: BodyLengths) -> LowerBody:
        sway = self.sway(t)
        down = np.zeros_like(t) if self.crouch is None else self.crouch(t)
        sit = np.zeros_like(t) if self.sit_at is None else ease((t - self.sit_at) / SITTING_DOWN)
        upright = body.ankle + 0.97 * body.leg
        height = upright - 0.52 * body.leg * down - sit * (upright - body.seat)
        forward = (1.0 - sit) * sway[:, 0] - 0.85 * body.thigh * sit - 0.06 * down
        pelvis, ankles = _planted(
            self.place,
            self.heading,
            body,
            np.column_stack([forward, (1.0 - sit) * sway[:, 1], height]),
            0.0,
            1.2,
        )
        lean = 0.03 + 0.65 * down + 0.12 * sit + 1.4 * sit * (1.0 - sit)
        return LowerBody(pelvis, self.heading + sway[:, 2], lean, ankles, np.zeros_like(t))


@dataclass(frozen=True)
class SitMotion:
    """Sitting on a chair, leaning forward at intervals."""

    place: tuple[float, float]  # m; floor point under the pelvis
    heading: float  # rad
    sway: SmoothNoise  # forward m, sideways m, turn rad
    lean: Pulses

    def __call__(self, t: Array, body: BodyLengths) -> LowerBody:
        sway = self.sway(t)
        local = np.column_stack([0.5 * sway[:, 0], 0.5 * sway[:, 1], np.full_like(t, body.seat)])
        pelvis, ankles = _planted(self.place, self.heading, body, local, 0.9 * body.thigh, 1.5)
        lean = 0.05 + 0.25 * self.lean(t)
        return LowerBody(pelvis, self.heading + 0.6 * sway[:, 2], lean, ankles, np.zeros_like(t))


def _planted(
    place: tuple[float, float], heading: float, body: BodyLengths, local: Array, ahead: float, spread: float
) -> tuple[Array, Array]:
    """Return the pelvis (T, 3) m from body axes to world, and fixed ankles (T, 2, 3) m.

    Args:
        place: Origin of the body axes on the floor (x, y) m.
        heading: Direction of the body's x axis, rad.
        local: Pelvis (T, 3) m in body axes.
        ahead: Distance of the ankles in front of the origin, m.
        spread: Distance between the ankles, in hip widths.
    """
    axes = axes_of(np.array([heading]), np.zeros(1))[0]
    origin = np.array([*place, 0.0])
    feet = np.array([[ahead, sign * spread * body.hip, body.ankle] for _, sign in SIDES])
    return origin + local @ axes.T, np.tile(origin + feet @ axes.T, (len(local), 1, 1))
