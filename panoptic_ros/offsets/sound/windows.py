"""Compare short windows with sound across recordings at high resolution, around known lags."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from panoptic_ros.offsets.sound.directness import Directness, Phases, directness
from panoptic_ros.offsets.sound.lines import SoundClockLines, arrivals, loops_close
from panoptic_ros.offsets.sound.listening import DeviceTime, SampleStream, band_energies, cut
from panoptic_ros.offsets.sound.matching import NORMAL_MEDIAN, vertex
from panoptic_ros.offsets.sound.onsets import onsets
from panoptic_ros.stage import Progress

Array = np.ndarray
RATE = 500.0  # Hz, rate of fine onsets
LENGTH_S, RISE_S = 0.012, 0.008  # s, length of the energy windows, and time over which their energy rises
WINDOW_S = 2.0  # s, length of a window
MOST = 240  # maximum number of windows
SEARCH_S = 0.08  # s, search range around the known lags
BEYOND_S = 0.6  # s, range of lags used to measure the chance agreement
SMOOTH = 5  # frames over which an agreement is averaged
CLEAR = 6.0  # robust standard deviations of a valid peak


def choose_windows(
    lines: SoundClockLines, loudness: list[Array], rate: float, times: list[DeviceTime]
) -> Array:
    """Return the start times (K,) s, in common time, of windows that at least two linked devices share.

    If there are too many windows, those with the most onsets are selected.

    Args:
        loudness: (T,) onset strength of each device, at `rate`.
    """
    members = np.flatnonzero(np.isfinite(lines.offsets))
    begins = np.array([lines.offsets[i] for i in members])
    ends = np.array([lines.offsets[i] + times[i].seconds for i in members])
    first, last = np.sort(begins)[1], np.sort(ends)[-2]
    starts = np.arange(first, last - WINDOW_S, WINDOW_S)
    if len(starts) <= MOST:
        return starts
    told = np.zeros(len(starts))
    for row, i in enumerate(members):
        total = np.concatenate([[0.0], np.cumsum(np.maximum(loudness[i], 0.0))])
        index = np.clip(((starts - begins[row]) * rate).astype(int), 0, len(total) - 1)
        until = np.clip(index + int(WINDOW_S * rate), 0, len(total) - 1)
        told += (total[until] - total[index]) / max(total[-1], 1e-9)
    cells = np.array_split(np.arange(len(starts)), MOST)
    return starts[[cell[int(np.argmax(told[cell]))] for cell in cells]]


@dataclass(frozen=True, eq=False)
class SoundWindows:
    """Results of K windows for D devices.

    Args:
        arrived: (D, K) s, arrival time relative to the lines; NaN without sound.
        directness: directness of the pairs of devices.
        shared: (D, D) number of windows that two devices have in common.
        clear: (D, D) number of windows in which two devices agree clearly.
    """

    arrived: Array
    directness: Directness
    shared: Array
    clear: Array


def hear_windows(
    lines: SoundClockLines,
    starts: Array,
    times: list[DeviceTime],
    streams: list[SampleStream],
    progress: Progress,
) -> SoundWindows:
    """Compare windows that begin at the common times (K,)."""
    count = len(times)
    members = [int(i) for i in np.flatnonzero(np.isfinite(lines.offsets))]
    heard = lines.heard(starts)
    spectra: dict[int, Array] = {}
    phases: dict[int, Phases] = {}
    begins = np.zeros((count, len(starts)))
    frames = int((WINDOW_S - LENGTH_S) * RATE)
    size = 1 << (frames + int(BEYOND_S * RATE) + 1).bit_length()
    for done, i in enumerate(members):
        progress(0.8 * done / len(members), f"listening to {times[i].device}")
        phases[i] = Phases.nothing(len(starts))
        spectra[i], begins[i] = _spectra(streams[i], times[i], heard[i], (frames, size), phases[i])
    arrived = np.full((count, len(starts)), np.nan)
    shared, clear = np.zeros((count, count), int), np.zeros((count, count), int)
    pairs = list(combinations(members, 2))
    found = np.full((len(pairs), len(starts)), np.nan)
    weight = np.zeros((len(pairs), len(starts)))
    for p, (a, b) in enumerate(pairs):
        progress(0.8 + 0.2 * p / len(pairs), "comparing windows")
        agreement = np.fft.irfft((np.conj(spectra[a]) * spectra[b]).sum(axis=2), size, axis=1)
        there = np.abs(spectra[a]).any(axis=(1, 2)) & np.abs(spectra[b]).any(axis=(1, 2))
        shared[a, b] = shared[b, a] = int(there.sum())
        lag, strength = _peaks(agreement)
        good = there & (strength >= CLEAR)
        clear[a, b] = clear[b, a] = int(good.sum())
        # Windows begin at a whole sample, slightly off the time that the lines give.
        beside = (begins[b] - heard[b]) - (begins[a] - heard[a])
        found[p, good], weight[p, good] = (lag + beside)[good], np.sqrt(strength[good])
    first, second = np.array(pairs).T if pairs else (np.empty(0, int), np.empty(0, int))
    recorded = np.sum([np.abs(spectra[i]).any(axis=(1, 2)) for i in members], axis=0)
    for k in range(len(starts)):
        good = np.isfinite(found[:, k])
        if recorded[k] > 2:
            good[good] = loops_close(first[good], second[good], found[good, k], count)
        if good.any():
            arrived[:, k] = arrivals(first[good], second[good], found[good, k], weight[good, k], count)
    direct = np.full((2, len(pairs), len(starts)), np.nan)
    for p, (a, b) in enumerate(pairs):
        lags = arrived[b] - arrived[a] - (begins[b] - heard[b]) + (begins[a] - heard[a])
        direct[:, p] = directness(phases[a], phases[b], lags)
    progress(1.0, "comparing windows")
    return SoundWindows(arrived, Directness(first, second, direct[0], direct[1]), shared, clear)


def _spectra(
    stream: SampleStream, time: DeviceTime, heard: Array, sizes: tuple[int, int], phases: Phases
) -> tuple[Array, Array]:
    """Return the onset spectra (K, F, B) of a device's windows, and their start times (K,).

    Spectra are 0 outside the recording. Start times are in s by the device's sample count. The phases of the
    same windows are stored in `phases`.

    Args:
        heard: (K,) s, start times by the lines.
        sizes: number of onset frames in a window, and length of their transform.
    """
    frames, size = sizes
    rate, length = time.sample_rate, int(LENGTH_S * time.sample_rate)
    first = np.rint(heard * rate).astype(np.int64)
    count = int(WINDOW_S * rate)
    inside = (first >= 0) & (first + count <= time.count)
    spans = [(int(begin), int(begin) + count) for begin in first[inside]]
    starts = np.rint(np.arange(frames) * rate / RATE).astype(np.int64)
    spectra = np.zeros((len(heard), size // 2 + 1, 8), np.complex64)
    for k, samples in zip(np.flatnonzero(inside), cut(stream, spans)):
        rises = onsets(band_energies(samples, starts, length, rate), RATE, RISE_S, squared=True)
        spectra[k] = np.fft.rfft(rises, size, axis=0)
        phases.hear(int(k), samples, rate)
    return spectra, first / rate


def _peaks(agreement: Array) -> tuple[Array, Array]:
    """Return the lag (K,) s of the best agreement within the search range, and its strength (K,)."""
    beyond, search = int(BEYOND_S * RATE), int(SEARCH_S * RATE)
    lags = np.arange(-beyond, beyond + 1)
    values = agreement[:, lags]
    kernel = np.hanning(SMOOTH + 2)[1:-1]
    values = np.apply_along_axis(np.convolve, 1, values, kernel / kernel.sum(), "same")
    outside = values[:, np.abs(lags) > search]
    noise = np.maximum(np.median(np.abs(outside), axis=1) / NORMAL_MEDIAN, 1e-9)
    middle = values[:, np.abs(lags) <= search]
    best = middle.argmax(axis=1)
    fine = np.array([vertex(row, int(k)) for row, k in zip(middle, best)])
    lag = (best - search + fine) / RATE
    strength = middle.max(axis=1) / noise
    return lag, np.where(np.abs(best - search) < search - 1, strength, 0.0)
