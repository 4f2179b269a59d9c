"""Simulated rooms with microphones for `panoptic study sound`, and control rooms without common sound."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain import AudioBlock
from panoptic_ros.graph.recording import InMemoryRecording
from panoptic_ros.simulation.room_sound import AcousticRoom, DrySound, SimulatedRecorder, record
from panoptic_ros.simulation.voices import RATE, clap, talk

Array = np.ndarray
Rng = np.random.Generator
SIZE = (7.5, 6.5, 2.8)  # m, of a room
REVERBERATION = (0.3, 0.8)  # s, range
RADIUS = (1.8, 3.0)  # m, range of the distance of microphones from the middle
RATES = (16_000, 22_050, 44_100, 48_000)  # Hz
LOUD = 8.0  # amplitude of a clap relative to speech
BEFORE_S, AFTER_S = 1.5, 6.0  # s by which sounds extend before and after the recording
DRIFT, MOST_DRIFT = 5e-5, 1e-4  # standard deviation and limit of clock drifts, s/s
BLOCK_S = 0.5  # s, length of an audio block


def _place(rng: Rng) -> Array:
    """Return a random place of a standing or sitting person."""
    return np.array([*rng.uniform([1.5, 1.2], [6.0, 5.3]), rng.uniform(1.1, 1.7)])


def _talkers(count: int) -> Callable[[Rng, float], list[DrySound]]:
    def sounds(rng: Rng, seconds: float) -> list[DrySound]:
        pieces: list[list[tuple[float, Array]]] = [[] for _ in range(count)]
        at = -BEFORE_S
        while at < seconds + AFTER_S:
            length = float(rng.uniform(1.5, 5.0))
            pieces[int(rng.integers(count))].append((at, talk(rng, length)))
            at += length + float(rng.uniform(0.2, 1.0))
        return [DrySound(_place(rng), own) for own in pieces]

    return sounds


def _claps(rng: Rng, seconds: float) -> list[DrySound]:
    """Return claps of two persons in turn, ten in all, at a random time of the recording."""
    places, at, sounds = [_place(rng), _place(rng)], float(rng.uniform(7.0, 10.0)), []
    for k in range(10):
        sounds.append(DrySound(places[k % 2], [(at, LOUD * clap(rng))]))
        at += float(rng.uniform(0.6, 3.5))
    return sounds


def _ticks(rng: Rng, seconds: float) -> list[DrySound]:
    tick = LOUD * clap(rng)
    times = np.arange(-1.0, seconds + AFTER_S, rng.uniform(0.4, 1.2))
    return [DrySound(_place(rng), [(float(at), tick) for at in times])]


def _loop(rng: Rng, seconds: float) -> list[DrySound]:
    """Return a bar of two seconds of music, repeated over the recording."""
    bar = [(float(k) / 4.0 + 0.02 * rng.standard_normal(), talk(rng, 0.2)) for k in range(8)]
    starts = np.arange(-2.0, seconds + AFTER_S, 2.0)
    return [DrySound(_place(rng), [(float(begin) + at, sound) for begin in starts for at, sound in bar])]


def _hum(rng: Rng, seconds: float) -> list[DrySound]:
    time = np.arange(int((seconds + AFTER_S) * RATE)) / RATE
    wave = sum(np.sin(2.0 * np.pi * 50.0 * k * time + rng.uniform(0.0, 6.3)) / k for k in range(1, 24))
    return [DrySound(_place(rng), [(-BEFORE_S, np.asarray(wave))])]


def _nothing(rng: Rng, seconds: float) -> list[DrySound]:
    return []


@dataclass(frozen=True)
class SoundCase:
    """Sound source of a room.

    Args:
        sounds: function that makes the sounds of a recording of this length (s).
        tells: True if the clocks can be estimated from the sounds.
        apart: each microphone is in a separate room.
    """

    about: str
    sounds: Callable[[Rng, float], list[DrySound]]
    tells: bool = True
    apart: bool = False


CASES = {
    "talker": SoundCase("one talks where he stands", _talkers(1)),
    "talkers": SoundCase("three talk in turn", _talkers(3)),
    "claps": SoundCase("two clap in turn, ten times in all", _claps),
    "other-rooms": SoundCase("talk in a room of its own for each", _talkers(2), False, True),
    "other-claps": SoundCase("ten claps in a room of its own for each", _claps, False, True),
    "ticks": SoundCase("one tick again and again, evenly", _ticks, False),
    "loop": SoundCase("music of two seconds again and again", _loop, False),
    "hum": SoundCase("mains hum with its overtones", _hum, False),
    "silence": SoundCase("nothing but noise", _nothing, False),
}


@dataclass(frozen=True, eq=False)
class RoomRecording:
    """Recording and ground truth of its devices.

    Args:
        recording: recording with the topic "audio" of each device.
        recorders: true position, clock and sample rate of each device.
        lengths: length (s) of each device's recording.
    """

    recording: InMemoryRecording
    recorders: dict[str, SimulatedRecorder]
    lengths: dict[str, float]

    @property
    def places(self) -> dict[str, Array]:
        """Return the positions (3,) m of the microphones."""
        return {name: np.array(recorder.place) for name, recorder in self.recorders.items()}

    @property
    def shared(self) -> tuple[float, float]:
        """Return begin and end (true s) of the time in which all devices record."""
        ends = [self.recorders[name].begin_s + self.lengths[name] for name in self.recorders]
        return max(recorder.begin_s for recorder in self.recorders.values()), min(ends)

    def offset(self, name: str, base: str, stamp_ns: int) -> float:
        """Return the time (s) by which the base clock is ahead of the device clock at a device timestamp."""
        one, other = self.recorders[name], self.recorders[base]
        true = one.begin_s + (1e-9 * stamp_ns - one.clock_s) / (1.0 + one.drift)
        return other.stamp_s(true) - 1e-9 * stamp_ns


def make_room(case: SoundCase, microphones: int, seed: int, seconds: float, snr_db: float) -> RoomRecording:
    """Simulate recordings that begin up to 5 s apart, with clock differences of up to 100 s."""
    rng = np.random.default_rng([seed, microphones, 11])
    room = AcousticRoom(SIZE, float(rng.uniform(*REVERBERATION)))
    angles = rng.uniform(0.0, 6.3) + np.linspace(0.0, 2.0 * np.pi, microphones, endpoint=False)
    angles += 0.2 * rng.standard_normal(microphones)
    radius = rng.uniform(*RADIUS, microphones)
    middle = 0.5 * np.array(SIZE)
    places = np.stack(
        [
            middle[0] + radius * np.cos(angles),
            middle[1] + radius * np.sin(angles),
            rng.uniform(1.0, 2.5, microphones),
        ],
        axis=1,
    )
    sounds = case.sounds(np.random.default_rng([seed, 12]), seconds)
    recorders: dict[str, SimulatedRecorder] = {}
    lengths: dict[str, float] = {}
    records: dict[str | tuple[str, str], list[AudioBlock]] = {}
    for k in range(microphones):
        x, y, z = np.clip(places[k], 0.1, np.array(SIZE) - 0.1)
        recorder = SimulatedRecorder(
            (float(x), float(y), float(z)),
            RATES[int(rng.integers(len(RATES)))],
            float(rng.uniform(0.0, 5.0)),
            float(rng.uniform(0.0, 100.0)),
            float(np.clip(DRIFT * rng.standard_normal(), -MOST_DRIFT, MOST_DRIFT)),
            snr_db,
        )
        if case.apart:
            sounds = case.sounds(np.random.default_rng([seed, 12, k]), seconds)
        length = seconds + float(rng.uniform(-3.0, 3.0))
        name = f"mic{k}"
        recorders[name], lengths[name] = recorder, length
        records["audio", name] = _blocks(name, recorder, record(room, sounds, recorder, length, (seed, k)))
    return RoomRecording(InMemoryRecording(records), recorders, lengths)


def _blocks(name: str, recorder: SimulatedRecorder, samples: Array) -> list[AudioBlock]:
    rate, begin = recorder.sample_rate, round(1e9 * recorder.clock_s)
    step = int(BLOCK_S * rate)
    return [
        AudioBlock(name, begin + k * 1_000_000_000 // rate, k, rate, samples[k : k + step])
        for k in range(0, len(samples), step)
    ]
