"""Finding a timecode signal: cell length, phase, direction and the place of the words, from nothing.

The energy of half-cell integrals is largest when every edge lies between two half cells. It is
computed for all cell lengths and phases over a short stretch, then sharpened on longer ones. The
best few lengths are tried in full, since patterns of bits can favour a multiple of the true one.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.timecode.cells import decide_bits, even_parity, half_cells, integrate
from panoptic_ros.timecode.words import WORD_CELLS, sync_matches

Array = np.ndarray
COARSE_SECONDS = 0.06
WINDOW_SECONDS = 0.42  # at least seven words
LONGER = (0.12, 0.25, 0.42)  # s, of the sharpening
PHASES = 8
CANDIDATES = 4
APART = 0.03  # relative difference of two candidates' cell lengths
LEAST_SHARE = 0.35  # of the signal's power that the half cells must hold; white noise has 1 / length
LEAST_SYNC = 15.0  # bits of 16, mean over the window
FASTEST, SLOWEST = 30.0, 24000.0 / 1001.0  # frames/s


@dataclass(frozen=True, slots=True)
class Found:
    """A signal: length of a cell and start of the first whole word, samples; direction; mean sync bits."""

    cell: float
    word_start: float
    reverse: bool
    sync: float


def acquire(cumulative: Array, sample_rate: int, speed_range: float) -> Found | None:
    """The timecode signal in a window, if there is one.

    Args:
        cumulative: (N + 1,) sums of the conditioned samples, see `integrate`.
        speed_range: how many times too fast or slow it may be.
    """
    shortest = sample_rate / (FASTEST * speed_range * WORD_CELLS)
    longest = sample_rate * speed_range / (SLOWEST * WORD_CELLS)
    length = len(cumulative) - 1
    if length < 2.5 * WORD_CELLS * shortest:
        return None
    found = []
    for half, edge in _coarse(cumulative, length, 0.5 * shortest, 0.5 * longest, sample_rate):
        half, edge = _sharpen(cumulative, length, half, edge, sample_rate)
        found += _words(cumulative, length, half, edge)
    good = [item for item in found if item.sync >= LEAST_SYNC]
    return max(good, key=lambda item: item.sync) if good else None


def _coarse(
    cumulative: Array, length: int, shortest: float, longest: float, sample_rate: int
) -> list[tuple[float, float]]:
    """Half-cell lengths that explain the middle of the window best, and an edge there."""
    span = min(COARSE_SECONDS * sample_rate, 0.9 * length)
    begin = 0.5 * (length - span)
    halves = span / shortest
    steps = int(2.0 * halves * np.log(longest / shortest)) + 2
    lengths = shortest * (longest / shortest) ** np.linspace(0.0, 1.0, steps)
    rows = []
    for half in lengths:
        phases = begin + half * np.arange(PHASES) / PHASES
        energies = _energy(cumulative, np.array([half]), phases, int(span / half) - 1)[0]
        best = int(np.argmax(energies))
        rows.append((float(energies[best]), float(half), float(phases[best])))
    rows.sort(reverse=True)
    samples = np.diff(cumulative[int(begin) : int(begin + span) + 1])
    if rows[0][0] < LEAST_SHARE * float(samples @ samples) / len(samples):
        return []
    chosen: list[tuple[float, float]] = []
    for _, half, edge in rows:
        if all(abs(half / other - 1.0) > APART for other, _ in chosen):
            chosen.append((half, edge))
        if len(chosen) == CANDIDATES:
            break
    return chosen


def _energy(cumulative: Array, halves: Array, starts: Array, count: int) -> Array:
    """Mean square level of `count` half cells, (H, S) for H lengths and S starts."""
    bounds = starts[None, :, None] + halves[:, None, None] * np.arange(count + 1)
    levels = np.diff(integrate(cumulative, bounds), axis=-1) / halves[:, None, None]
    return (levels * levels).mean(axis=-1)


def _sharpen(
    cumulative: Array, length: int, half: float, edge: float, sample_rate: int
) -> tuple[float, float]:
    """Length and an edge near the middle of the window, from stretches that grow about the middle."""
    middle = edge + half * round((0.5 * length - edge) / half)
    for seconds in LONGER:
        each_side = int(0.5 * min(seconds * sample_rate, 0.98 * length) / half)
        step_length, step_phase = half / (2.0 * each_side), 0.25 * half
        for _ in range(4):
            lengths = half + step_length * np.linspace(-1.0, 1.0, 5)
            shifts = middle + step_phase * np.linspace(-1.0, 1.0, 5)
            offsets = np.arange(-each_side, each_side + 1)
            bounds = shifts[None, :, None] + lengths[:, None, None] * offsets
            levels = np.diff(integrate(cumulative, bounds), axis=-1) / lengths[:, None, None]
            best = np.unravel_index(int(np.argmax((levels * levels).mean(-1))), (5, 5))
            half, middle = float(lengths[best[0]]), float(shifts[best[1]])
            step_length, step_phase = 0.5 * step_length, 0.5 * step_phase
    return half, middle


def _words(cumulative: Array, length: int, half: float, edge: float) -> list[Found]:
    """Where words begin, for both directions."""
    first = edge - half * np.floor(edge / half)
    count = int((length - first) / half) // 2
    halves = half_cells(cumulative, first, 2.0 * half, count)
    if not even_parity(halves):
        first, count = first + half, count - 1
        halves = halves[1 : 2 * count + 1]
    bits, _ = decide_bits(halves)
    if count < 2 * WORD_CELLS:
        return []
    found = []
    for reverse in (False, True):
        matches = sync_matches(bits, reverse)
        means = np.array([matches[k::WORD_CELLS].mean() for k in range(WORD_CELLS)])
        best = int(np.argmax(means))
        word = best if reverse else (best + 16) % WORD_CELLS  # the sync word ends a word
        found.append(Found(2.0 * half, first + 2.0 * half * word, reverse, float(means[best])))
    return found
