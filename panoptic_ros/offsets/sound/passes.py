"""Estimate the clocks of a recorded capture from the sound of its devices.

`CoarseLags` finds the lags between pairs of recordings by their onsets, at any lag. `SoundClocks` is the
complete pass.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.offsets.clocks import CameraClocks
from panoptic_ros.offsets.sound.directness import Directness
from panoptic_ros.offsets.sound.heard import PairSound, SoundClockEstimate, clocks_of, middles_of
from panoptic_ros.offsets.sound.lines import Lags, SoundClockLines, fit_lines, largest_group, settle
from panoptic_ros.offsets.sound.listening import DeviceTime, SampleStream, coarse_energies
from panoptic_ros.offsets.sound.matching import EVENTS, LENGTH_S, LEVEL, RATE, RISE_S, STRONG, LagMatch, find
from panoptic_ros.offsets.sound.onsets import onsets
from panoptic_ros.offsets.sound.travel import SPEED_OF_SOUND, SourcePositions, unknown_travel
from panoptic_ros.offsets.sound.windows import choose_windows, hear_windows
from panoptic_ros.stage import Progress, Recording, part_of

SEGMENT_S = 60.0  # s, length of the parts that are searched for in the other recordings
MOST_SEGMENTS = 12
# s, uncertainty of a lag predicted from another part of the pair, and from a chain of other pairs
NEAR_S, CHAIN_S = 0.1, 1.0
COARSE_S = 0.01  # s, standard deviation of a coarse lag
DRIFTS = 3e-4  # maximum relative drift of two clocks
Array = np.ndarray
APART = 6.0  # m, assumed maximum distance of two microphones
LEAST_CLEAR = 2  # minimum number of windows in which a device must be confirmed


class CoarseLags:
    """Lags between pairs of recordings, found by their onsets at any lag.

    Args:
        rises: (T, B) coarse onsets of each device.
    """

    def __init__(self, rises: Sequence[Array]):
        self._rises = rises
        self._first: list[int] = []
        self._second: list[int] = []
        self._found: list[LagMatch] = []
        self.why: dict[tuple[int, int], str] = {}
        self.contradicted: dict[tuple[int, int], str] = {}

    def compare(self, a: int, b: int) -> None:
        """Find and store the lags at which parts of the shorter recording occur in the longer one.

        If other pairs already link the two, or a part has been found, further parts are searched near that
        lag. If a part matches beyond doubt at another lag, the two recordings contradict each other.
        """
        first, second = (b, a) if len(self._rises[a]) > len(self._rises[b]) else (a, b)
        part, whole = self._rises[first], self._rises[second]
        near = self._predicted(first, second)
        best: LagMatch | None = None
        linked = False
        for begin in _segments(part):
            segment, at = part[begin : begin + round(SEGMENT_S * RATE)], begin / RATE
            if near is not None:
                reach = near.reach + DRIFTS * abs(at - near.at)
                match = find(segment, whole, near.lag + at, reach)
                if match is not None and match.expected:
                    self._remember(first, second, match, at)
                    linked = True
                    continue
            match = find(segment, whole)
            if match is None:
                continue
            if match.unique and near is None:
                near, linked = _LagGate(match.lag - at, NEAR_S, match.at + at), True
                self._remember(first, second, match, at)
            elif match.unique and near is not None:
                apart = match.lag - at - near.lag
                if abs(apart) > near.reach + DRIFTS * abs(at - near.at):
                    self.contradicted[a, b] = f"after {at:.0f} s it is {apart:+.2f} s off: is sound missing?"
            if best is None or match.strength * match.ratio > best.strength * best.ratio:
                best = match
        if not linked:
            self.why[a, b] = _reason(best)

    def _remember(self, first: int, second: int, match: LagMatch, at: float) -> None:
        self._first.append(first)
        self._second.append(second)
        self._found.append(replace(match, lag=match.lag - at, at=match.at + at, other=match.other - at))

    def _predicted(self, first: int, second: int) -> _LagGate | None:
        """Return the lag of two devices that a chain of other pairs links; None if no chain links the two."""
        group = self._group(np.arange(len(self._rises)))
        if first not in group or second not in group:
            return None
        lines = self._fit(group)
        middle = 0.5 * len(self._rises[first]) / RATE
        return _LagGate(float(lines.offsets[first] - lines.offsets[second]), CHAIN_S, middle)

    def _group(self, among: Array) -> Array:
        """Return the largest group of linked devices among the given ones."""
        first, second = np.array(self._first, int), np.array(self._second, int)
        inside = np.isin(first, among) & np.isin(second, among)
        return largest_group(len(self._rises), first[inside], second[inside])

    def _fit(self, group: Array) -> SoundClockLines:
        first, second = np.array(self._first, int), np.array(self._second, int)
        inside = np.isin(first, group) & np.isin(second, group)
        found = [match for match, use in zip(self._found, inside) if use]
        return fit_lines(
            len(self._rises),
            group,
            Lags(
                first[inside],
                second[inside],
                np.array([match.at for match in found]),
                np.array([match.lag for match in found]),
                np.full(len(found), COARSE_S),
            ),
        )

    def lines(self) -> tuple[SoundClockLines, Array]:
        """Return the lines of the largest group of devices that lags link, and its indices.

        Devices with the most contradictions are removed first, until no contradiction remains.
        """
        count = len(self._rises)
        kept = np.arange(count)
        while against := [pair for pair in self.contradicted if set(pair) <= set(kept.tolist())]:
            times = np.bincount(np.array(against).ravel(), minlength=count)
            worst = np.flatnonzero(times == times.max())
            kept = np.setdiff1d(kept, worst)
            for pair in against:
                if set(pair) & set(worst.tolist()):
                    self.why.setdefault(pair, self.contradicted[pair])
        group = self._group(kept)
        if len(group) < 2:
            return SoundClockLines(np.full(count, np.nan), np.full(count, np.nan), 0.0), group[:0]
        return self._fit(group), group


@dataclass(frozen=True)
class _LagGate:
    """Lag (s) known to within `reach` (s), at time `at` (s) of the first device."""

    lag: float
    reach: float
    at: float


def _segments(rises: Array) -> list[int]:
    """Return the first frame of one segment per part of a long recording, segments with most onsets first."""
    length = round(SEGMENT_S * RATE)
    if len(rises) <= 1.5 * length:
        return [0] if len(rises) <= length else [0, len(rises) - length]
    total = np.concatenate([[0.0], np.cumsum(np.maximum(rises, 0.0).sum(axis=1))])
    starts = np.arange(0, len(rises) - length + 1, length // 4)
    told = total[starts + length] - total[starts]
    cells = np.array_split(np.arange(len(starts)), min(MOST_SEGMENTS, max(1, len(rises) // length)))
    chosen = [cell[int(np.argmax(told[cell]))] for cell in cells if len(cell)]
    return [int(starts[k]) for k in sorted(chosen, key=lambda k: -told[k])]


def _reason(best: LagMatch | None) -> str:
    """Return a short reason why two recordings are not linked."""
    if best is None:
        return "silence, or less than 5 s"
    if best.strength < STRONG:
        return "no lag stands out: the recordings have nothing in common, or the sound repeats"
    if best.events < EVENTS:
        return "too few sounds in common"
    return f"it repeats: {abs(best.other - best.lag):.2f} s on fits nearly as well"


@dataclass(frozen=True)
class SoundClocksConfig:
    """Configuration of `SoundClocks`.

    Args:
        cameras: device with the sound of each camera; "" = none.
        positions: (3,) m, known positions of microphones, by device.
        apart: (m) maximum distance of microphones without known positions.
        trusted_camera: camera whose timestamps are right; "": see `heard.clocks_of`.
    """

    cameras: Mapping[str, str]
    positions: Mapping[str, Array] = field(default_factory=dict)
    apart: float = APART
    trusted_camera: str = ""


class SoundClocks:
    """Pass (`stage.Pass`) that estimates camera clocks from the topic "audio", one scope per device.

    Sound is read twice in pieces, so that memory grows with the onsets alone (3 kB per second and device).
    First, parts of each recording are searched for in all others at any lag (`matching`). The lines through
    these lags determine where to compare windows at high resolution (`windows`). The final clocks follow from
    the windows (`lines`).

    Raises:
        UsageError: the trusted camera has no sound.
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

    def run(self, recording: Recording, progress: Progress) -> SoundClockEstimate:
        """Return the clocks; they are unknown if sound does not determine them."""
        refused: dict[str, str] = {}
        times, rises = self._listen(recording, part_of(progress, 0.0, 0.4), refused)
        devices = list(times)
        pairs = list(combinations(range(len(devices)), 2))
        coarse = CoarseLags([rises[name] for name in devices])
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
            PairSound(
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
        return SoundClockEstimate(clocks, evidence, unknown, apart, self._placed(devices), middles)

    def _listen(
        self, recording: Recording, progress: Progress, refused: dict[str, str]
    ) -> tuple[dict[str, DeviceTime], dict[str, Array]]:
        """Return the sample time of each device, and its coarse onsets (T, B)."""
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
        """Return the travel time of sound (s) between the two devices farthest apart."""
        if not self._placed(devices):
            return self._config.apart / SPEED_OF_SOUND
        places = np.array([self._config.positions[name] for name in devices]).reshape(-1, 3)
        ways = np.linalg.norm(places[:, None] - places, axis=2)
        return float(ways.max(initial=0.0)) / SPEED_OF_SOUND

    def _travel(self, devices: list[str], heard: Directness) -> tuple[Array, Array]:
        if not self._placed(devices):
            return unknown_travel(len(devices), self._config.apart)
        return SourcePositions(np.array([self._config.positions[name] for name in devices])).travel(heard)

    def _why(
        self, device: str, devices: list[str], members: Array, coarse: CoarseLags, refused: Mapping[str, str]
    ) -> str:
        if not device:
            return "no sound"
        if device in refused:
            return refused[device]
        i = devices.index(device)
        reasons = [why for pair, why in coarse.why.items() if i in pair]
        if not reasons:
            return (
                "it has too little sound in common with the others" if len(devices) > 1 else "no other sound"
            )
        return max(reasons, key=reasons.count)


def _confirmed(lines: SoundClockLines, arrived: Array) -> tuple[SoundClockLines, Array]:
    """Set the lines and arrivals of devices that arrive in fewer than `LEAST_CLEAR` windows to NaN.

    If fewer than two devices remain, the lines of all devices are NaN.
    """
    heard = np.isfinite(arrived).sum(axis=1) >= LEAST_CLEAR
    offsets = np.where(heard, lines.offsets, np.nan)
    drifts = np.where(heard, lines.drifts, np.nan)
    if heard.sum() < 2:
        offsets[:] = drifts[:] = np.nan
    return SoundClockLines(offsets, drifts, lines.middle), np.where(heard[:, None], arrived, np.nan)
