"""What the cameras of a take hear: its people talk in turn, in a room, each camera on its own clock."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from panoptic_ros.domain import AudioBlock
from panoptic_ros.simulation.room_sound import DrySound, Recorder, Room, record
from panoptic_ros.simulation.simulate import Simulation
from panoptic_ros.simulation.skeleton import JOINTS
from panoptic_ros.simulation.voices import talk

Array = np.ndarray
SECOND = 1_000_000_000
EARLY_S, LATE_S = 25.0, 3.0  # by which cameras hear before and after they see
RATES = (16_000, 22_050, 48_000, 44_100)  # Hz, dealt out in turn
HEIGHT = 3.2  # m, of the room
WALL = 0.6  # m, behind the outermost camera
REVERBERATION = (0.3, 0.6)  # s
BLOCK = 8000  # samples


def recorders(take: Simulation) -> list[Recorder]:
    """The microphone of each camera, where the camera is."""
    corner = _corner(take)
    return [
        Recorder(
            tuple(np.clip(camera.centre - corner, 0.1, None)),
            RATES[k % len(RATES)],
            begin_s=-EARLY_S,
            clock_s=1e-9 * take.stamp_ns(k, -EARLY_S),
            drift=take.clocks[k].drift,
        )
        for k, camera in enumerate(take.rig.cameras)
    ]


def heard_by(take: Simulation) -> Iterator[tuple[str, Recorder, Array]]:
    """Each camera, its microphone, and what that records (N,)."""
    rng = np.random.default_rng([*take.seed, 6])
    corner = _corner(take)
    centres = np.array([camera.centre for camera in take.rig.cameras])
    size = np.ptp(centres, axis=0) + 2.0 * WALL
    room = Room((float(size[0]), float(size[1]), HEIGHT), float(rng.uniform(*REVERBERATION)))
    sounds = _voices(take, rng, corner)
    for k, (camera, recorder) in enumerate(zip(take.rig.cameras, recorders(take))):
        length = EARLY_S + take.seconds + LATE_S
        yield camera.name, recorder, record(room, sounds, recorder, length, (*take.seed, 7, k))


def heard_blocks(take: Simulation) -> Iterator[tuple[float, AudioBlock]]:
    """The same as blocks, with the times of the schedule at which they begin."""
    for name, recorder, samples in heard_by(take):
        for first in range(0, len(samples), BLOCK):
            stamp = round(SECOND * recorder.clock_s) + first * SECOND // recorder.sample_rate
            piece = samples[first : first + BLOCK]
            since = first / recorder.sample_rate - EARLY_S
            yield since, AudioBlock(name, stamp, first, recorder.sample_rate, piece)


def _corner(take: Simulation) -> Array:
    """The corner of the room in the world; its floor is the world's."""
    lowest = np.min([camera.centre for camera in take.rig.cameras], axis=0) - WALL
    return np.array([lowest[0], lowest[1], 0.0])


def _voices(take: Simulation, rng: np.random.Generator, corner: Array) -> list[DrySound]:
    """Sentences of people who take turns, each from where a head is then."""
    sounds, at = [], -EARLY_S - 1.0
    while at < take.seconds + LATE_S:
        length = float(rng.uniform(1.5, 4.0))
        person = take.people[int(rng.integers(len(take.people)))]
        when = np.array([min(max(at, 0.0), take.seconds)])
        place = person.joints(when)[0][JOINTS.index("Nose")] - corner
        sounds.append(DrySound(place, [(at, talk(rng, length))]))
        at += length + float(rng.uniform(0.2, 0.8))
    return sounds
