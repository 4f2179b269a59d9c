"""Scenes of free-running cameras: people who run faster and faster, swing their arms, pass, come and go."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from panoptic_ros.simulation.body import BodyLengths, Posture
from panoptic_ros.simulation.degradation import Degradation
from panoptic_ros.simulation.free_running import FreeRunning, FreeRunningScene
from panoptic_ros.simulation.gestures import HANGING, draw_gesture
from panoptic_ros.simulation.motions import StandMotion, StepMotion
from panoptic_ros.simulation.paths import RoundPath
from panoptic_ros.simulation.people import SimulatedPerson, draw_person, draw_sway, keep_apart
from panoptic_ros.simulation.rigs import VGA, Lens, Ring
from panoptic_ros.simulation.stagings import StagingArea, crossing, visitor

Array = np.ndarray
TOP_TEMPO = 2.6  # tempo at the end of a capture over that at its start
STRIDE, CADENCE = 1.05, 0.9  # m per gait cycle, gait cycles per s at tempo 1
SWING_HZ = 1.1  # arm swings per second at tempo 1
SWING = 1.0  # rad, amplitude of an arm swing: wrists reach 10 m/s at the end
AREA = 2.6  # m, radius of the space that visitors cross

# noise of 1.4 px, half of it persistent: 1 px is 4.4 mm in the middle of the ring
DETECTOR = Degradation(
    noise_px=1.4,
    memory_share=0.5,
    joint_miss=0.03,
    outlier=0.01,
    outlier_px=60.0,
    hidden_miss=0.4,
    hidden_noise=2.5,
    limb_swap=0.005,
)
# DETECTOR in images a third as wide
VGA_DETECTOR = replace(DETECTOR, noise_px=0.5, outlier_px=20.0)
# DETECTOR with the faults that concern whole people
FAULTY = replace(
    DETECTOR, person_miss=0.03, fewest_joints=4, back_swap=0.01, duplicate=0.01, merge=0.03, ghosts=0.1
)


@dataclass(frozen=True)
class FasterPerson(SimulatedPerson):
    """Person whose tempo grows linearly from 1 at t = 0 to `top` at t = `seconds`."""

    top: float = field(kw_only=True)
    seconds: float = field(kw_only=True)

    def posture(self, t: Array) -> Posture:
        """See `SimulatedPerson`."""
        t = np.asarray(t, np.float64)
        return super().posture(t + 0.5 * (self.top - 1.0) / self.seconds * t * t)


@dataclass(frozen=True)
class PendulumSwing:
    """Stretched arms that swing forward and backward in turn, about the shoulders."""

    def __call__(self, t: Array, steps: Array) -> Array:
        """See `gestures.HandMove`."""
        phase = 2.0 * np.pi * SWING_HZ * t
        angles = SWING * np.stack([np.sin(phase), -np.sin(phase)], axis=1)
        aside = np.full_like(angles, 0.2 + HANGING[1])
        hands: Array = 0.97 * np.stack([np.sin(angles), aside, -np.cos(angles)], axis=-1) - HANGING
        return hands


def faster(person: SimulatedPerson, seconds: float, top: float = TOP_TEMPO) -> FasterPerson:
    """Return the person with a tempo that grows up to `top` in `seconds` s."""
    return FasterPerson(**vars(person) | {"top": top, "seconds": seconds})


def one_runner(rng: np.random.Generator, seconds: float) -> list[SimulatedPerson]:
    """Return one person who walks and then runs on a circle."""
    return [_runner(rng, 0, (0.0, 0.0), seconds)]


def one_walker(rng: np.random.Generator, seconds: float) -> list[SimulatedPerson]:
    """Return one person who walks about."""
    return [draw_person(rng, 0, "walk", rng.uniform(1.6, 1.9), 1.6)]


def runner_and_talker(rng: np.random.Generator, seconds: float) -> list[SimulatedPerson]:
    """Return a runner, and a person who stands in the middle of the circle and talks."""
    return [_runner(rng, 0, (0.0, 0.0), seconds), draw_person(rng, 1, "talk", rng.uniform(1.6, 1.9), 0.2)]


def two_runners(rng: np.random.Generator, seconds: float) -> list[SimulatedPerson]:
    """Return two runners who pass head-on at half a metre, several times."""
    area = StagingArea(("run", "run"), 0.0, 0.0)
    return [faster(person, seconds) for person in crossing(rng, area)]


def arm_swinger(rng: np.random.Generator, seconds: float) -> list[SimulatedPerson]:
    """Return one standing person who swings both arms, with wrists at up to 10 m/s."""
    motion = StandMotion((0.0, 0.0), rng.uniform(0.0, 2.0 * np.pi), draw_sway(rng))
    gesture = replace(draw_gesture(rng, "swing"), move=PendulumSwing())
    person = SimulatedPerson(0, BodyLengths.draw(rng, rng.uniform(1.6, 1.9)), motion, gesture)
    return [faster(person, seconds)]


def six_visitors(rng: np.random.Generator, seconds: float) -> list[SimulatedPerson]:
    """Return six people: one stays and talks, one walks round it and leaves, four enter and leave."""
    times = np.arange(0.0, seconds, 0.1)
    people: list[SimulatedPerson] = [draw_person(rng, 0, "talk", rng.uniform(1.6, 1.9), 0.2)]
    walker = draw_person(rng, 1, "walk", rng.uniform(1.6, 1.9), AREA)
    people.append(replace(walker, present=(-np.inf, 0.7 * seconds)))
    for number, share in enumerate((0.05, 0.15, 0.4, 0.55), start=2):

        def make(number: int = number, enter: float = share * seconds) -> SimulatedPerson:
            return visitor(rng, number, (enter, np.inf), AREA)

        people.append(keep_apart(make, people, 0.5, times))
    return people


def _runner(
    rng: np.random.Generator, number: int, centre: Sequence[float], seconds: float
) -> SimulatedPerson:
    radius = rng.uniform(1.3, 1.8)
    turn = rng.choice([-1.0, 1.0]) * STRIDE / radius
    path = RoundPath((centre[0], centre[1]), radius, rng.uniform(0.0, 2.0 * np.pi), turn, (0.08, 0.04))
    motion = StepMotion(path, CADENCE * rng.uniform(0.95, 1.05))
    person = SimulatedPerson(
        number, BodyLengths.draw(rng, rng.uniform(1.6, 1.9)), motion, draw_gesture(rng, "swing")
    )
    return faster(person, seconds)


def _ring(cameras: int) -> Ring:
    return Ring(cameras, radius=5.0)


_STAGGERED = FreeRunning((12.5,), staggered=True)
FREE_RUNNING_SCENES: dict[str, FreeRunningScene] = {
    scene.name: scene
    for scene in (
        FreeRunningScene(
            "faster",
            "11 cameras of 6.4 Hz, random phases; one person walks and runs",
            one_runner,
            _ring(11),
            FreeRunning((70.0 / 11.0,)),
            DETECTOR,
            14.0,
        ),
        FreeRunningScene(
            "staggered",
            "8 cameras of 12.5 Hz, phases evenly apart; one person runs, one stands",
            runner_and_talker,
            _ring(8),
            _STAGGERED,
            DETECTOR,
            10.0,
        ),
        FreeRunningScene(
            "crossing",
            "8 cameras of 12.5 Hz, phases evenly apart; two runners pass at 0.5 m",
            two_runners,
            _ring(8),
            _STAGGERED,
            DETECTOR,
            10.0,
        ),
        FreeRunningScene(
            "free",
            "4 cameras of 25, 30, 50 and 60 Hz; arm swings of up to 10 m/s",
            arm_swinger,
            _ring(4),
            FreeRunning((25.0, 30.0, 50.0, 60.0)),
            DETECTOR,
            10.0,
        ),
        FreeRunningScene(
            "clocks",
            "8 cameras of 25 Hz, clocks off by up to 60 ms and 60 ppm; one runner",
            one_runner,
            _ring(8),
            FreeRunning((25.0,), offset_s=0.06, drift_ppm=60.0),
            DETECTOR,
            10.0,
        ),
        FreeRunningScene(
            "shutter",
            "6 cameras of 30 Hz, four with a rolling shutter of 15 to 30 us per row; one runner",
            one_runner,
            _ring(6),
            FreeRunning((30.0,), global_every=3),
            DETECTOR,
            10.0,
        ),
        FreeRunningScene(
            "visitors",
            "8 cameras of 12.5 Hz, random phases; six people enter and leave, all faults of a detector",
            six_visitors,
            _ring(8),
            FreeRunning((12.5,)),
            FAULTY,
            20.0,
        ),
        FreeRunningScene(
            "rendered",
            "11 cameras of 6.4 Hz, random phases; one person walks, with rendered VGA images",
            one_walker,
            Ring(11, radius=3.9, heights=(1.0, 2.8), lens=Lens(VGA, (425.0, 440.0), distorted_every=0)),
            FreeRunning((70.0 / 11.0,)),
            VGA_DETECTOR,
            6.0,
        ),
    )
}
