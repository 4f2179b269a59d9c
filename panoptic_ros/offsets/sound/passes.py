"""Clocks of a recorded capture from the sound that its devices heard."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.offsets.clocks import CameraClocks
from panoptic_ros.offsets.sound.coarse import Coarse
from panoptic_ros.offsets.sound.directness import Directness
from panoptic_ros.offsets.sound.heard import HeardClocks, PairHeard, clocks_of, middles_of
from panoptic_ros.offsets.sound.lines import Lines, settle
from panoptic_ros.offsets.sound.listening import DeviceTime, SampleStream, coarse_energies
from panoptic_ros.offsets.sound.matching import LENGTH_S, LEVEL, RATE, RISE_S
from panoptic_ros.offsets.sound.onsets import onsets
from panoptic_ros.offsets.sound.travel import SPEED_OF_SOUND, Places, unknown_travel
from panoptic_ros.offsets.sound.windows import choose_windows, hear_windows
from panoptic_ros.stage import Progress, Recording, part_of

Array = np.ndarray
APART = 6.0  # m
LEAST_CLEAR = 2  # windows in which a pair must agree


@dataclass(frozen=True)
class SoundClocksConfig:
    """What `SoundClocks` needs to know.

    Args:
        cameras: the device that heard for each camera; "" where there is none.
        positions: (3,) m of the microphones, where they are known.
        apart: m, how far apart microphones without a position are, at most.
        trusted_camera: its stamps are right; "": see `heard.clocks_of`.
    """

    cameras: Mapping[str, str]
    positions: Mapping[str, Array] = field(default_factory=dict)
    apart: float = APART
    trusted_camera: str = ""


class SoundClocks:
    """The cameras' clocks from the topic "audio" of a recording, one scope per device: a `stage.Pass`.

    Sound is read twice, piece by piece, so that memory grows with onsets alone (3 kB a second and device).
    First, parts of each recording are looked for in all of the others, at any lag (`matching`). Lines
    through these lags say where to compare windows finely (`windows`), from which clocks are settled
    (`lines`).

    Raises:
        UsageError: if the trusted camera has no sound.
    """

    def __init__(self, config: SoundClocksConfig):
        self._config = config
        self._devices = tuple(dict.fromkeys(name for name in config.cameras.values() if name))
        trusted = config.trusted_camera
        if trusted and not config.cameras.get(trusted):
            heard = ", ".join(name for name, device in config.cameras.items() if device) or "none"
            raise UsageError(
                f"there is no sound of the trusted camera {trusted!r}; cameras with sound: {heard}"
            )

    def run(self, recording: Recording, progress: Progress) -> HeardClocks:
        """The clocks; not known where sound does not tell."""
        refused: dict[str, str] = {}
        times, rises = self._listen(recording, part_of(progress, 0.0, 0.4), refused)
        devices = list(times)
        pairs = list(combinations(range(len(devices)), 2))
        coarse = Coarse([rises[name] for name in devices])
        told = part_of(progress, 0.4, 0.6)
        for done, (a, b) in enumerate(pairs):
            told(done / len(pairs), f"looking for {devices[a]} in {devices[b]}")
            coarse.compare(a, b)
        lines, members = coarse.lines()
        clocked = [times[name] for name in devices]
        told = part_of(progress, 0.6, 1.0)
        shared, clear = (np.zeros((len(devices), len(devices)), int) for _ in range(2))
        apart = self._apart([devices[i] for i in members])
        if len(members) > 1:
            loudness = [rises[name].sum(axis=1) for name in devices]
            starts = choose_windows(lines, loudness, RATE, clocked)
            streams = [SampleStream(recording.records("audio", name)) for name in devices]
            heard = hear_windows(lines, starts, clocked, streams, told)
            shared, clear = heard.shared, heard.clear
            lines, arrived = _confirmed(lines, heard.arrived)
            delays, spread = self._travel(devices, heard.directness)
            settled = settle(lines, starts + 0.0, arrived, delays, spread)
            number = {name: k for k, name in enumerate(devices)}
            cameras = {name: number.get(device, -1) for name, device in self._config.cameras.items()}
            clocks = clocks_of(settled, clocked, cameras, self._config.trusted_camera)
            middles = middles_of(settled, clocked, cameras, clocks)
        else:
            clocks = CameraClocks.unknown(self._config.cameras, 0)
            middles = np.zeros(len(clocks.cameras), np.int64)
        members = np.flatnonzero(np.isfinite(lines.offsets))
        evidence = tuple(
            PairHeard(
                devices[a],
                devices[b],
                a in members and b in members,
                int(shared[a, b]),
                int(clear[a, b]),
                coarse.why.get((a, b), ""),
            )
            for a, b in pairs
        )
        unknown = {
            name: self._why(device, devices, members, coarse, refused)
            for (name, device), known in zip(self._config.cameras.items(), clocks.known)
            if not known
        }
        progress(1.0, "done")
        return HeardClocks(clocks, evidence, unknown, apart, self._placed(devices), middles)

    def _listen(
        self, recording: Recording, progress: Progress, refused: dict[str, str]
    ) -> tuple[dict[str, DeviceTime], dict[str, Array]]:
        """How samples and stamps of each device belong together, and its coarse onsets (T, B)."""
        times, rises = {}, {}
        for done, name in enumerate(self._devices):
            progress(done / len(self._devices), f"listening to {name}")
            stream = SampleStream(recording.records("audio", name))
            try:
                energies = coarse_energies(stream, RATE, LENGTH_S)
                times[name] = stream.time()
            except DataError as error:
                refused[name] = str(error)
                continue
            rises[name] = onsets(energies, RATE, RISE_S, squared=False, level=LEVEL)
        return times, rises

    def _placed(self, devices: list[str]) -> bool:
        return all(name in self._config.positions for name in devices)

    def _apart(self, devices: list[str]) -> float:
        """s, of sound between the two that are farthest apart."""
        if not self._placed(devices):
            return self._config.apart / SPEED_OF_SOUND
        places = np.array([self._config.positions[name] for name in devices]).reshape(-1, 3)
        ways = np.linalg.norm(places[:, None] - places, axis=2)
        return float(ways.max(initial=0.0)) / SPEED_OF_SOUND

    def _travel(self, devices: list[str], heard: Directness) -> tuple[Array, Array]:
        if not self._placed(devices):
            return unknown_travel(len(devices), self._config.apart)
        return Places(np.array([self._config.positions[name] for name in devices])).travel(heard)

    def _why(
        self, device: str, devices: list[str], members: Array, coarse: Coarse, refused: Mapping[str, str]
    ) -> str:
        if not device:
            return "no sound"
        if device in refused:
            return refused[device]
        i = devices.index(device)
        reasons = [why for pair, why in coarse.why.items() if i in pair]
        if not reasons:
            return "it hears too little together with the others" if len(devices) > 1 else "no other sound"
        return max(reasons, key=reasons.count)


def _confirmed(lines: Lines, arrived: Array) -> tuple[Lines, Array]:
    """Without devices that windows do not confirm."""
    heard = np.isfinite(arrived).sum(axis=1) >= LEAST_CLEAR
    offsets = np.where(heard, lines.offsets, np.nan)
    drifts = np.where(heard, lines.drifts, np.nan)
    if heard.sum() < 2:
        offsets[:] = drifts[:] = np.nan
    return Lines(offsets, drifts, lines.middle), np.where(heard[:, None], arrived, np.nan)
