"""Measure how directly two microphones receive a sound, from the phases of their waveforms.

In a room, the direct sound is followed by reflections from the walls. The generalised cross correlation with
phase transform (GCC-PHAT, Knapp and Carter 1976) of two microphones has a peak. The peak is higher, the more
energy reaches both microphones directly. Close to a talker the sound is dry. Far away, a reverberation tail
follows it. Most of the correlation then lies on the side of the peak that belongs to the far microphone. The
peak itself may be that of an echo.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray
# Hz, band limits. Above 4 kHz a relative drift of 1e-4 between two clocks changes their phase difference too
# much within a part
LOW, HIGH = 200, 4000
SIZE = 8192  # lags per second
PARTS = 2  # number of parts of 1 s in a window
NEAR_S = 0.025  # s around the onset lag, search range of the peak: a room delays onsets against direct sound
BESIDE_S, TAIL_S = 0.0005, 0.06  # s from the peak, limits of the correlation tail
LEVELS = 256  # quantisation levels of a phase
TURN = np.exp(2j * np.pi * np.arange(LEVELS) / LEVELS).astype(np.complex64)


@dataclass(frozen=True, eq=False)
class Phases:
    """Spectral phases in K windows of a device.

    Args:
        phases: (K, PARTS, HIGH - LOW) uint8, in 1/256 of a turn.
        there: (K, PARTS) bool, True if the part has sound.
    """

    phases: Array
    there: Array

    @classmethod
    def nothing(cls, count: int) -> Phases:
        """Return `count` windows without sound."""
        return cls(np.zeros((count, PARTS, HIGH - LOW), np.uint8), np.zeros((count, PARTS), bool))

    def hear(self, window: int, samples: Array, rate: int) -> None:
        """Store the phases of the samples (N, C) of a window.

        Parts with constant samples are skipped. So are all parts if the sample rate does not cover the band.
        """
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
    """Directness of P pairs of devices in K windows, NaN without common sound.

    Args:
        first, second: (P,) devices.
        heights: (P, K) height of the correlation peak, 1 for identical sound.
        tails: (P, K) log ratio of the correlation energy after the peak to that before it.
    """

    first: Array
    second: Array
    heights: Array
    tails: Array


def directness(first: Phases, second: Phases, lags: Array) -> tuple[Array, Array]:
    """Return the heights (K,) and tails (K,) of two devices, see `Directness`.

    Args:
        lags: (K,) s by which the onsets in a window of the second device are later; NaN = no common sound.
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
        chance = len(beside) / (2.0 * values)  # energy of unrelated phases
        after, before = (
            max(float((agreement[(peak + side * beside) % SIZE] ** 2).sum()) - chance, 0.3 * chance)
            for side in (1, -1)
        )
        heights[k], tails[k] = agreement[peak % SIZE], np.log(after / before)
    return heights, tails
