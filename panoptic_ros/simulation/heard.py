"""Audio that the cameras of a take record.

People talk in turn in a reverberant room, and each camera records on its own clock.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from panoptic_ros.domain import AudioBlock
from panoptic_ros.simulation.room_sound import AcousticRoom, DrySound, SimulatedRecorder, record
from panoptic_ros.simulation.simulate import Simulation
from panoptic_ros.simulation.skeleton import JOINTS
from panoptic_ros.simulation.voices import talk

Array = np.ndarray
SECOND = 1_000_000_000
EARLY_S, LATE_S = 25.0, 3.0  # s; length of the audio before and after the images
RATES = (16_000, 22_050, 48_000, 44_100)  # Hz; sample rates assigned to the cameras in rotation
HEIGHT = 3.2  # m; height of the room
WALL = 0.6  # m; distance of the walls behind the outermost cameras
REVERBERATION = (0.3, 0.6)  # s; range of the reverberation time
BLOCK = 8000  # samples of an audio block


def recorders(take: Simulation) -> list[SimulatedRecorder]:
    """Return one microphone per camera, at the camera's position."""
    corner = _corner(take)
    return [
        SimulatedRecorder(
            tuple(np.clip(camera.centre - corner, 0.1, None)),
            RATES[k % len(RATES)],
            begin_s=-EARLY_S,
            clock_s=1e-9 * take.stamp_ns(k, -EARLY_S),
            drift=take.clocks[k].drift,
        )
        for k, camera in enumerate(take.rig.cameras)
    ]


def heard_by(take: Simulation) -> Iterator[tuple[str, SimulatedRecorder, Array]]:
    """Yield each camera's name, its microphone, and the recorded samples (N,)."""
    rng = np.random.default_rng([*take.seed, 6])
    corner = _corner(take)
    centres = np.array([camera.centre for camera in take.rig.cameras])
    size = np.ptp(centres, axis=0) + 2.0 * WALL
    room = AcousticRoom((float(size[0]), float(size[1]), HEIGHT), float(rng.uniform(*REVERBERATION)))
    sounds = _voices(take, rng, corner)
    for k, (camera, recorder) in enumerate(zip(take.rig.cameras, recorders(take))):
        length = EARLY_S + take.seconds + LATE_S
        yield camera.name, recorder, record(room, sounds, recorder, length, (*take.seed, 7, k))


def heard_blocks(take: Simulation) -> Iterator[tuple[float, AudioBlock]]:
    """Yield the recordings as audio blocks, each with its start time in s of the schedule."""
    for name, recorder, samples in heard_by(take):
        for first in range(0, len(samples), BLOCK):
            stamp = round(SECOND * recorder.clock_s) + first * SECOND // recorder.sample_rate
            piece = samples[first : first + BLOCK]
            since = first / recorder.sample_rate - EARLY_S
            yield since, AudioBlock(name, stamp, first, recorder.sample_rate, piece)


def _corner(take: Simulation) -> Array:
    """Return the corner (3,) m of the room in the world frame, with the room's floor at z = 0."""
    lowest = np.min([camera.centre for camera in take.rig.cameras], axis=0) - WALL
    return np.array([lowest[0], lowest[1], 0.0])


def _voices(take: Simulation, rng: np.random.Generator, corner: Array) -> list[DrySound]:
    """Return sentences of people who talk in turn, each at the speaker's head position at that time."""
    sounds, at = [], -EARLY_S - 1.0
    while at < take.seconds + LATE_S:
        length = float(rng.uniform(1.5, 4.0))
        person = take.people[int(rng.integers(len(take.people)))]
        when = np.array([min(max(at, 0.0), take.seconds)])
        place = person.joints(when)[0][JOINTS.index("Nose")] - corner
        sounds.append(DrySound(place, [(at, talk(rng, length))]))
        at += length + float(rng.uniform(0.2, 0.8))
    return sounds
