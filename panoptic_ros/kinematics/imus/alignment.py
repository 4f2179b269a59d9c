"""Heading and clock offset of IMUs from motion.

The rotation of a segment over a quarter of a second does not depend on how a device is mounted. In the world,
the acceleration of the place of the device does not depend on it either. Both are compared between cameras
and IMUs.

Cameras determine some rotations better than others, according to the covariances of their poses. They hardly
determine rotations of limbs about their own axes. The size of the errors of rotations and of accelerations is
unknown. Each kind is therefore weighted by its own residuals (the likelihood with its variance eliminated).

`compare_turned` compares vectors that were measured in a frame of another heading with vectors from cameras,
at several clock offsets.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d

from panoptic_ros.domain.subjects import BodyState, Device, ImuSeries, Subject
from panoptic_ros.geometry.rotations import vectors_of
from panoptic_ros.kernels import njit
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.imus.measured import resample

Array = np.ndarray

TURN_S = 0.25  # interval of the rotations that are compared
SMOOTHING_S = 0.06  # smoothing of accelerations, about 3 Hz
COMPARED_S = 0.05  # interval between compared instants
TISSUE = math.radians(3.0)  # rotation of an IMU on its segment, by soft tissue
OFFSETS_S = np.arange(-0.15, 0.1501, 0.005)
HEADINGS = 720
# maximum standard deviation of a usable heading: beyond it, the motion is insufficient
LEAST_SURE = math.radians(6.0)
ALIGNED_LAG_S = 0.2  # lag of the compared poses: with a smaller lag, late poses look like a clock offset
# s; standard deviations: smaller offsets are within the error of the estimate
LEAST_OFFSET_S, SURE = 0.012, 3.0
LIKELY = 4.5  # nats, log-likelihood difference at three standard deviations
SAME_S = 0.3  # correlation time of errors, s
CLOCK_SD = 0.004  # s, error that is constant within a capture: late poses, soft tissue
OWN_HEADING = math.radians(2.0)  # heading of each device relative to the common one
ENOUGH_S, ENOUGH = 0.008, math.radians(2.5)  # standard deviations below which no more motion is needed
GRAVITY = np.array([0.0, 0.0, 9.81])


@njit(cache=True, error_model="numpy", nogil=True)
def compare_turned(
    felt: tuple[Array, Array], seen: tuple[Array, Array, Array], offsets: Array
) -> tuple[Array, Array, Array, Array]:
    """Compare measured vectors with vectors from cameras, per clock offset, as a function of the heading.

    The sum of weighted squared residuals is t^T matrix t - 2 vector^T t + constant, where t is the cosine and
    sine of the heading.

    Args:
        felt: Timestamps (N,), rising, and vectors (N, 3). Vectors are interpolated linearly; NaN = missing.
        seen: Timestamps (T,), vectors (T, 3) and their information (T, 3, 3).
        offsets: (O,) of the clock of the measured vectors, in the unit of the timestamps.

    Returns:
        matrices (O, 2, 2), vectors (O, 2), constants (O,), and numbers of compared instants (O,).
    """
    when, vectors = felt
    stamps, goals, information = seen
    count = len(offsets)
    matrices, pulls = np.zeros((count, 2, 2)), np.zeros((count, 2))
    constants, numbers = np.zeros(count), np.zeros(count, np.int64)
    there, rest, level, weighed = np.empty(3), np.empty(3), np.zeros((3, 2)), np.empty((3, 2))
    for o in range(count):
        k = 0
        for t in range(len(stamps)):
            moment = stamps[t] - offsets[o]
            while k < len(when) - 2 and when[k + 1] <= moment:
                k += 1
            share = min(max((moment - when[k]) / (when[k + 1] - when[k]), 0.0), 1.0)
            for i in range(3):
                there[i] = vectors[k, i] + share * (vectors[k + 1, i] - vectors[k, i])
            if not (math.isfinite(there[0]) and math.isfinite(there[1]) and math.isfinite(there[2])):
                continue
            numbers[o] += 1
            level[0, 0], level[1, 0], level[0, 1], level[1, 1] = there[0], there[1], -there[1], there[0]
            for i in range(3):
                rest[i] = goals[t, i]
            rest[2] -= there[2]
            for i in range(3):
                for j in range(2):
                    weighed[i, j] = information[t, i, 0] * level[0, j] + information[t, i, 1] * level[1, j]
            for j in range(2):
                for m in range(2):
                    matrices[o, j, m] += level[0, j] * weighed[0, m] + level[1, j] * weighed[1, m]
                for i in range(3):
                    pulls[o, j] += weighed[i, j] * rest[i]
            for i in range(3):
                for m in range(3):
                    constants[o] += rest[i] * information[t, i, m] * rest[m]
    return matrices, pulls, constants, numbers


class DeviceSignals(NamedTuple):
    """Measurements of a device at a fixed rate.

    Attributes:
        stamps: (N,) ns.
        turns: (N, 3, 3), orientations, inertial frame from device; NaN = missing.
        forces: (N, 3) m/s^2, specific forces in the device frame; NaN = missing.
    """

    stamps: Array
    turns: Array
    forces: Array


class ImuAlignment(NamedTuple):
    """Alignment of IMUs in space and time.

    Attributes:
        heading, heading_unsure: rad, world from inertial frame, and its standard deviation.
        offset, unsure: s, added to the timestamps of the IMUs, and its standard deviation.
    """

    heading: float
    offset: float
    heading_unsure: float
    unsure: float

    @property
    def late(self) -> bool:
        """Return whether the clock is off by more than the error of the estimate."""
        return abs(self.offset) >= max(LEAST_OFFSET_S, SURE * self.unsure)

    @property
    def enough(self) -> bool:
        """Return whether both are so certain that more motion is not worth waiting for."""
        return self.heading_unsure < ENOUGH and self.unsure < ENOUGH_S


class _VectorPair(NamedTuple):
    """The same vectors, measured by a device and seen by cameras.

    Attributes:
        when, felt: (N,) ns and (N, 3), in the inertial frame.
        stamps, seen: (T,) ns and (T, 3), in the world.
        information: (T, 3, 3) of `seen`, up to a common factor.
    """

    when: Array
    felt: Array
    stamps: Array
    seen: Array
    information: Array


class _BodyTrajectory(NamedTuple):
    """Bodies at a fixed rate; NaN = missing.

    Attributes:
        stamps: (T,) ns.
        places, frames: (T, S, 3) m and (T, S, 3, 3).
        covariances: (T, S, 3, 3) rad^2, of small rotations.
        step: s, between instants.
    """

    stamps: Array
    places: Array
    frames: Array
    covariances: Array
    step: float


def align(
    subject: Subject, states: Sequence[BodyState], felt: Mapping[str, DeviceSignals]
) -> ImuAlignment | None:
    """Return the alignment of a subject's IMUs in space and time, or None without enough motion.

    Args:
        states: Bodies solved in the window from cameras alone, at a fixed rate. Those without covariances
            are treated as exact.
        felt: Measurements by device.
    """
    worn = [device for device in subject.devices if device.name in felt]
    if len(states) < 10 or not worn:
        return None
    seen = _regular(states)
    kinds = [
        [_turns(seen, device, felt[device.name]) for device in worn],
        [_accelerations(seen, device, felt[device.name]) for device in worn],
    ]
    headings = np.zeros(1) if subject.heading_known else 2.0 * np.pi * np.arange(HEADINGS) / HEADINGS - np.pi
    fits = [_fit(pairs, headings) for pairs in kinds]
    surface = sum(1.5 * fit.counts.sum() * COMPARED_S / SAME_S * np.log(fit.variances) for fit in fits)
    assert isinstance(surface, np.ndarray)
    best, turned = map(int, np.unravel_index(int(np.argmin(surface)), surface.shape))
    likelihood = surface.min(axis=1)
    offset, _ = _vertex(OFFSETS_S, likelihood, best)
    # `_valley` gives only the standard deviation. The lowest minimum gives the offset
    _, unsure = _valley(OFFSETS_S, likelihood)
    heading, heading_unsure = 0.0, 0.0
    if not subject.heading_known:
        alike = _of_devices(fits, best, turned)
        turned, near = int(np.argmin(alike)), np.array([-4, 0, 4])
        apart, heading_unsure = _vertex(2.0 * np.pi / HEADINGS * near, alike[(turned + near) % HEADINGS], 1)
        heading = float(headings[turned]) + apart
    if not heading_unsure < LEAST_SURE:
        return None
    return ImuAlignment(heading, offset, heading_unsure, math.hypot(unsure, CLOCK_SD))


def _regular(states: Sequence[BodyState]) -> _BodyTrajectory:
    """Return the bodies on a grid of timestamps without gaps."""
    stamps = np.array([state.stamp_ns for state in states])
    step = float(np.median(np.diff(stamps)))
    rows = np.round((stamps - stamps[0]) / step).astype(int)
    count, segments = int(rows[-1]) + 1, len(states[0].places)
    places, frames = np.full((count, segments, 3), np.nan), np.full((count, segments, 3, 3), np.nan)
    covariances = np.full((count, segments, 3, 3), np.nan)
    places[rows], frames[rows] = [s.places for s in states], [s.frames for s in states]
    exact = np.zeros((segments, 3, 3))
    covariances[rows] = [exact if s.covariances is None else s.covariances[:, 3:, 3:] for s in states]
    grid = stamps[0] + np.round(step * np.arange(count)).astype(np.int64)
    return _BodyTrajectory(grid, places, frames, covariances, 1e-9 * step)


def _turns(seen: _BodyTrajectory, device: Device, felt: DeviceSignals) -> _VectorPair:
    """Return the rotations of the segment and of the device over TURN_S, at the middle of this interval."""
    frames, spread = seen.frames[:, device.segment], seen.covariances[:, device.segment]
    back = max(round(TURN_S / seen.step), 1)
    information = np.full((len(frames) - back, 3, 3), np.nan)
    both = spread[back:] + spread[:-back] + TISSUE**2 * np.eye(3)
    known = np.isfinite(both).all((1, 2))
    information[known] = np.linalg.inv(both[known])
    own = max(round(TURN_S / (1e-9 * float(np.median(np.diff(felt.stamps))))), 1)
    return _thinned(
        _VectorPair(
            (felt.stamps[own:] + felt.stamps[:-own]) // 2,
            _between(felt.turns, own),
            (seen.stamps[back:] + seen.stamps[:-back]) // 2,
            _between(frames, back),
            information,
        ),
        seen.step,
    )


def _accelerations(seen: _BodyTrajectory, device: Device, felt: DeviceSignals) -> _VectorPair:
    """Return the accelerations of the place of the device, below about 3 Hz."""
    site = seen.places[:, device.segment] + seen.frames[:, device.segment] @ device.position
    own = 1e-9 * float(np.median(np.diff(felt.stamps)))
    forces = (felt.turns @ felt.forces[..., None])[..., 0] - GRAVITY
    pushed = np.gradient(np.gradient(site, seen.step, axis=0), seen.step, axis=0)
    return _thinned(
        _VectorPair(
            felt.stamps,
            gaussian_filter1d(forces, SMOOTHING_S / own, axis=0),
            seen.stamps,
            gaussian_filter1d(pushed, SMOOTHING_S / seen.step, axis=0),
            np.tile(np.eye(3), (len(site), 1, 1)),
        ),
        seen.step,
    )


def _between(frames: Array, steps: int) -> Array:
    """Return the rotation vectors (T - steps, 3), in the world, over `steps` frames each.

    Args:
        frames: (T, 3, 3).
    """
    turned = frames[steps:] @ frames[:-steps].swapaxes(1, 2)
    known = np.isfinite(turned).all((1, 2))
    found = np.full((len(turned), 3), np.nan)
    found[known] = vectors_of(np.ascontiguousarray(turned[known]))
    return found


def _thinned(pair: _VectorPair, step: float) -> _VectorPair:
    every = max(round(COMPARED_S / step), 1)
    return pair._replace(
        stamps=pair.stamps[::every], seen=pair.seen[::every], information=pair.information[::every]
    )


class _AlignmentResiduals(NamedTuple):
    """Residuals of one kind of data.

    Attributes:
        left: (O, D, H), sums of weighted squares by clock offset, device and heading.
        counts: (D,), numbers of instants.
    """

    left: Array
    counts: Array

    @property
    def variances(self) -> Array:
        """Return the most likely variances (O, H) of the residuals."""
        found: Array = np.maximum(self.left.sum(1), 1e-12) / max(int(self.counts.sum()), 1)
        return found


def _fit(pairs: Sequence[_VectorPair], headings: Array) -> _AlignmentResiduals:
    """Return the residuals of one kind of data, for all devices."""
    turns = np.stack([np.cos(headings), np.sin(headings)])
    left, counts = np.zeros((len(OFFSETS_S), len(pairs), len(headings))), np.zeros(len(pairs), int)
    for d, pair in enumerate(map(_covered, pairs)):
        counts[d] = len(pair.stamps)
        begin = int(pair.when[0])
        seen = pair.stamps - begin, pair.seen, pair.information
        sums = compare_turned((pair.when - begin, pair.felt), seen, 1e9 * OFFSETS_S)
        for o, (matrix, vector, constant, count) in enumerate(zip(*sums)):
            found = (turns * (matrix @ turns)).sum(0) - 2.0 * vector @ turns + constant
            left[o, d] = found * (len(pair.stamps) / max(count, 1))
    return _AlignmentResiduals(left, counts)


def _of_devices(fits: Sequence[_AlignmentResiduals], offset: int, heading: int) -> Array:
    """Return minus the log-likelihood (H,) of the common heading.

    Each device has its own heading, which is normally distributed about the common one.
    """
    own = sum(
        0.5 * COMPARED_S / SAME_S * fit.left[offset] / fit.variances[offset, heading] * 3.0 for fit in fits
    )
    apart = np.arange(HEADINGS) * 2.0 * np.pi / HEADINGS
    apart = np.minimum(apart, 2.0 * np.pi - apart)
    spread = np.exp(-0.5 * (apart / OWN_HEADING) ** 2)
    likely = np.exp(own.min(1, keepdims=True) - own)
    blurred = np.fft.irfft(np.fft.rfft(likely, axis=1) * np.fft.rfft(spread), HEADINGS, axis=1)
    found: Array = -np.log(np.maximum(blurred, 1e-12)).sum(0)
    return found


def _covered(pair: _VectorPair) -> _VectorPair:
    """Return the part of the camera data that has IMU samples at all clock offsets."""
    most = 1e9 * float(np.abs(OFFSETS_S).max())
    there = (pair.stamps >= pair.when[0] + most) & (pair.stamps <= pair.when[-1] - most)
    there &= np.isfinite(pair.seen).all(-1) & np.isfinite(pair.information).all((1, 2))
    return pair._replace(
        stamps=pair.stamps[there], seen=pair.seen[there], information=pair.information[there]
    )


def _vertex(grid: Array, values: Array, k: int) -> tuple[float, float]:
    """Return the minimum of a parabola through a value and its neighbours, and the standard deviation there.

    The values are minus log-likelihoods. The standard deviation is infinite at the ends of the grid.
    """
    if not 0 < k < len(values) - 1:
        return float(grid[k]), math.inf
    spacing = float(grid[1] - grid[0])
    bend = float(values[k - 1] - 2.0 * values[k] + values[k + 1]) / spacing**2
    if bend <= 0.0:
        return float(grid[k]), math.inf
    slope = float(values[k + 1] - values[k - 1]) / (2.0 * spacing)
    return float(grid[k]) - slope / bend, 1.0 / math.sqrt(bend)


def _valley(grid: Array, values: Array) -> tuple[float, float]:
    """Return minimum and standard deviation, from a parabola through all values near the least value.

    With little motion the minimum is wide and rough, and the two neighbours that `_vertex` uses do not show
    the width. The standard deviation is infinite if the used values reach an end of the grid.
    """
    k, near = int(values.argmin()), np.flatnonzero(values <= values.min() + LIKELY)
    first, last = min(int(near[0]), k - 1), max(int(near[-1]), k + 1)
    if first <= 0 or last >= len(grid) - 1:
        return float(grid[k]), math.inf
    middle = 0.5 * float(grid[first] + grid[last])
    bend, slope, _ = np.polyfit(grid[first : last + 1] - middle, values[first : last + 1], 2).tolist()
    if bend <= 0.0:
        return float(grid[k]), math.inf
    return middle - 0.5 * slope / bend, 1.0 / math.sqrt(2.0 * bend)


def felt_of(series: ImuSeries, rate_hz: float) -> DeviceSignals:
    """Return the measurements of a device at a fixed rate."""
    count = int((series.stamps[-1] - series.stamps[0]) * 1e-9 * rate_hz) + 1
    stamps = series.stamps[0] + np.round(np.arange(count) * 1e9 / rate_hz).astype(np.int64)
    measured = resample(series, stamps)
    return DeviceSignals(stamps, measured.orientations, measured.forces)


def cameras_alone(config: KinematicsConfig) -> KinematicsConfig:
    """Return the configuration for motion from cameras alone, which is compared with IMUs."""
    return replace(config, lag=ALIGNED_LAG_S)


def taken_over(subject: Subject, found: ImuAlignment, clocks: bool) -> tuple[float, int, list[str]]:
    """Return the heading, rad, the offset for the IMUs' timestamps, ns, and lines about changes.

    The lines are about values that differ from the stated ones.

    Args:
        clocks: True if a clock offset is to be applied.
    """
    heading, offset_ns, lines = 0.0, 0, []
    if not subject.heading_known:
        heading = found.heading
        lines.append(f"heading of the IMUs found from motion: {math.degrees(heading):.1f} deg")
    if clocks and found.late:
        offset_ns = round(1e9 * found.offset)
        lines.append(f"clock of the IMUs found from motion: {1e3 * found.offset:+.0f} ms")
    return heading, offset_ns, lines
