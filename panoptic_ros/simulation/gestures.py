"""Motions of arms and head.

Hand positions are relative to the shoulder: forward, outward, up, in arm lengths.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from panoptic_ros.simulation.body import UpperBody
from panoptic_ros.simulation.smooth import Pulses, SmoothNoise, ease

Array = np.ndarray
HANGING = np.array([0.06, 0.10, -0.95])
WAVE_HZ = 3.0
# (begin, end) of the embrace in s, and duration in s of raising or lowering the arms
EMBRACE, EMBRACING = (0.9, 2.3), 0.35
HandMove = Callable[[Array, Array], Array]  # times (T,), gait cycles (T,) -> change of hands (T, 2, 3)


@dataclass(frozen=True)
class Gesture:
    """Upper-body motion: hanging, wandering arms with `move` added, and a head that looks around."""

    look: SmoothNoise  # twist of the chest, turn and nod of the head, rad
    wander: SmoothNoise  # random motion of both hands
    move: HandMove

    def __call__(self, t: Array, steps: Array) -> UpperBody:
        """Return the upper body at times (T,) s and gait cycles (T,)."""
        look = self.look(t)
        hands = HANGING + self.wander(t).reshape(-1, 2, 3) + self.move(t, steps)
        return UpperBody(hands, look[:, 0], look[:, 1], 0.1 + look[:, 2])


@dataclass(frozen=True)
class ArmSwing:
    """Arms that swing opposite to the legs."""

    def __call__(self, t: Array, steps: Array) -> Array:
        swing = 0.32 * np.cos(2.0 * np.pi * steps)
        up = 0.10 + 0.4 * swing * swing
        level = np.zeros_like(t)
        sides = (np.column_stack([0.05 + sign * swing, level, up]) for sign in (-1.0, 1.0))
        return np.stack(list(sides), axis=1)


@dataclass(frozen=True)
class TalkGesture:
    """Gestures of both hands in front of the body."""

    motion: SmoothNoise

    def __call__(self, t: Array, steps: Array) -> Array:
        hands: Array = np.array([0.38, 0.0, 0.50]) + self.motion(t).reshape(-1, 2, 3)
        return hands


@dataclass(frozen=True)
class ReachGesture:
    """Repeated reaching of one hand to a fixed goal and back."""

    hand: int
    pulses: Pulses
    goal: tuple[float, float, float]

    def __call__(self, t: Array, steps: Array) -> Array:
        return _one_hand(self.hand, self.pulses(t)[:, None] * (np.array(self.goal) - HANGING))


@dataclass(frozen=True)
class WaveGesture:
    """Fast waving of one raised hand."""

    hand: int

    def __call__(self, t: Array, steps: Array) -> Array:
        outward = 0.38 + 0.30 * np.sin(2.0 * np.pi * WAVE_HZ * t)
        up = 0.70 - 0.5 * (outward - 0.38) ** 2
        return _one_hand(self.hand, np.column_stack([np.full_like(t, 0.20), outward, up]) - HANGING)


@dataclass(frozen=True)
class TableGesture:
    """Hands held over a table, with one hand going to the mouth at intervals."""

    hand: int
    motion: SmoothNoise
    pulses: Pulses

    def __call__(self, t: Array, steps: Array) -> Array:
        sip = self.pulses(t)[:, None] * np.array([-0.12, -0.20, 0.50])
        over = np.array([0.50, -0.05, 0.55]) + self.motion(t).reshape(-1, 2, 3)
        hands: Array = over + _one_hand(self.hand, sip)
        return hands


@dataclass(frozen=True)
class EmbraceGesture:
    """Embrace: both arms reach around a person in front, hold, and return."""

    begin: float  # s; begin of raising the arms
    end: float

    def __call__(self, t: Array, steps: Array) -> Array:
        there = ease((t - self.begin) / EMBRACING) * ease((self.end - t) / EMBRACING)
        hands: Array = there[:, None, None] * (np.array([0.52, -0.22, -0.10]) - HANGING)
        return np.broadcast_to(hands, (len(t), 2, 3))


def draw_gesture(rng: np.random.Generator, kind: str) -> Gesture:
    """Draw a random gesture of a kind: "swing", "talk", "reach", "wave", "table" or "embrace"."""
    look = SmoothNoise.draw(rng, [0.07, 0.25, 0.085], 0.1, 0.5)
    wander = SmoothNoise.draw(rng, [0.014] * 6, 0.2, 0.8)
    hand = int(rng.integers(2))
    goal = (float(rng.uniform(0.6, 0.8)), 0.15, float(rng.uniform(-0.2, 0.55)))
    moves: dict[str, Callable[[], HandMove]] = {
        "swing": ArmSwing,
        "talk": lambda: TalkGesture(SmoothNoise.draw(rng, [0.09, 0.07, 0.11] * 2, 0.3, 1.4)),
        "reach": lambda: ReachGesture(hand, Pulses.draw(rng, 2.0, 3.5), goal),
        "wave": lambda: WaveGesture(hand),
        "table": lambda: TableGesture(
            hand, SmoothNoise.draw(rng, [0.07, 0.055, 0.035] * 2, 0.2, 0.9), Pulses.draw(rng, 2.5, 4.5)
        ),
        "embrace": lambda: EmbraceGesture(*EMBRACE),
    }
    return Gesture(look, wander, moves[kind]())


def _one_hand(hand: int, change: Array) -> Array:
    """Return the change (T, 2, 3) of both hands that moves only hand `hand` by `change` (T, 3)."""
    hands = np.zeros((len(change), 2, 3))
    hands[:, hand] = change
    return hands
