"""How directly two microphones hear what is said, from the phases of their waveforms.

In a room a waveform comes straight and then over the walls. Where two microphones hear it, their generalised
cross correlation with phase transform (Knapp and Carter 1976) has a peak, which is the higher the more of the
energy came straight to both. Beside a talker what is heard is dry, far from him it is followed by its tail:
then most of the correlation lies on the far one's side of the peak. The peak itself may be an echo's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray
LOW, HIGH = 200, 4000  # Hz: above it clocks that drift apart by 1e-4 do not agree within a part
SIZE = 8192  # lags of a second
PARTS = 2  # of a second each, in a window
NEAR_S = 0.025  # around the lag of onsets in which the peak lies: later than straight, by the room
BESIDE_S, TAIL_S = 0.0005, 0.06  # from the peak, where the correlation is tail
LEVELS = 256  # of a phase
TURN = np.exp(2j * np.pi * np.arange(LEVELS) / LEVELS).astype(np.complex64)


@dataclass(frozen=True, eq=False)
class Phases:
    """Of K windows of a device: phases (K, PARTS, HIGH - LOW) uint8 in 1/256 of a turn; there (K, PARTS)."""

    phases: Array
    there: Array

    @classmethod
    def nothing(cls, count: int) -> Phases:
        """Before anything is heard."""
        return cls(np.zeros((count, PARTS, HIGH - LOW), np.uint8), np.zeros((count, PARTS), bool))

    def hear(self, window: int, samples: Array, rate: int) -> None:
        """Take the samples (N, C) of a window; where all are alike, or the rate has no such band, nothing."""
        if rate <= 2 * HIGH:
            return
        taper = np.hanning(rate)
        for part in range(PARTS):
            piece = samples[part * rate : (part + 1) * rate].mean(axis=1)
            if len(piece) == rate and np.ptp(piece) > 0.0:
                angle = np.angle(np.fft.rfft(piece * taper)[LOW:HIGH])
                self.phases[window, part] = (
                    np.rint(angle * (LEVELS / (2.0 * np.pi))).astype(np.int16) % LEVELS
                )
                self.there[window, part] = True


@dataclass(frozen=True, eq=False)
class Directness:
    """Of P pairs of devices in K windows, NaN where not heard.

    Args:
        first, second: (P,) devices.
        heights: (P, K) of the peak, 1 where both hear the same.
        tails: (P, K) log of the correlation's energy after the peak over that before it.
    """

    first: Array
    second: Array
    heights: Array
    tails: Array


def directness(first: Phases, second: Phases, lags: Array) -> tuple[Array, Array]:
    """Heights (K,) and tails (K,) of two devices, see `Directness`.

    Args:
        lags: (K,) s by which onsets in a window of the second are later; NaN = not heard.
    """
    heights, tails = np.full(len(lags), np.nan), np.full(len(lags), np.nan)
    both = first.there & second.there
    for k in np.flatnonzero(np.isfinite(lags) & both.any(axis=1)):
        parts = both[k]
        turned = TURN[second.phases[k, parts] - first.phases[k, parts]].sum(axis=0)
        values = parts.sum() * (HIGH - LOW)
        spectrum = np.zeros(SIZE // 2 + 1, np.complex64)
        spectrum[LOW:HIGH] = turned
        agreement = np.fft.irfft(spectrum, SIZE) * (0.5 * SIZE / values)
        near = round(float(lags[k]) * SIZE) + np.arange(-int(NEAR_S * SIZE), int(NEAR_S * SIZE) + 1)
        peak = int(near[np.argmax(agreement[near % SIZE])])
        beside = np.arange(int(BESIDE_S * SIZE), int(TAIL_S * SIZE))
        chance = len(beside) / (2.0 * values)  # energy of phases that have nothing to do with each other
        after, before = (
            max(float((agreement[(peak + side * beside) % SIZE] ** 2).sum()) - chance, 0.3 * chance)
            for side in (1, -1)
        )
        heights[k], tails[k] = agreement[peak % SIZE], np.log(after / before)
    return heights, tails
