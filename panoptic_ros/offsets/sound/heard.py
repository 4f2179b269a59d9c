"""Derive camera clocks from the sound of their devices, with reasons for clocks that stay unknown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from panoptic_ros.offsets.clocks import CameraClocks
from panoptic_ros.offsets.sound.lines import LineEstimate
from panoptic_ros.offsets.sound.listening import DeviceTime
from panoptic_ros.solving.clock_gauge import AGREE, CHANCE

Array = np.ndarray
SECOND = 1_000_000_000


@dataclass(frozen=True)
class PairSound:
    """Common sound of two devices.

    Args:
        first, second: names of the devices.
        linked: True if their lag is known from their sound.
        windows: (count) windows that both recorded.
        clear: (count) windows in which they agree beyond doubt.
        why: short reason if they are not linked.
    """

    first: str
    second: str
    linked: bool
    windows: int = 0
    clear: int = 0
    why: str = ""


@dataclass(frozen=True, eq=False)
class SoundClockEstimate:
    """Clocks of cameras from the sound of their devices.

    Args:
        clocks: camera clocks, in the same form as from motion. A clock is known if sound gives it, for any
            standard deviation.
        pairs: pairs of devices.
        unknown: {camera: reason why its clock is unknown}.
        apart_s: (s) travel time of sound over the largest distance of two linked devices.
        placed: True if that distance comes from known positions.
        middles_ns: (C,) ns, time of each camera clock in the middle of the common sound. Offsets are stated
            for that time. For unknown clocks, it is the reference of the clocks.
    """

    clocks: CameraClocks
    pairs: tuple[PairSound, ...]
    unknown: Mapping[str, str]
    apart_s: float
    placed: bool
    middles_ns: Array


def clocks_of(
    settled: LineEstimate, times: Sequence[DeviceTime], cameras: Mapping[str, int], trusted: str
) -> CameraClocks:
    """Return the clocks of cameras; cameras without a linked device get an offset of 0.

    The reference clock is that of the trusted camera. Without one, it is a clock of the majority if most
    clocks agree. Otherwise it is the clock that is farthest ahead, so that no timestamp becomes negative.

    Args:
        times: sample time of D devices.
        cameras: device index of each camera, or -1.
    """
    lines, count = settled.lines, len(times)
    linked = np.isfinite(lines.offsets)
    names = tuple(cameras)
    devices = np.array([cameras[name] for name in names], int)
    known = (devices >= 0) & np.where(devices >= 0, linked[devices], False)
    if known.sum() < 2:
        return CameraClocks.unknown(names, 0)
    shown = _shown(lines.heard(np.array([lines.middle]))[:, 0], times, linked)
    speed = np.array([(1.0 - d) * (1.0 + t.excess) for d, t in zip(np.nan_to_num(lines.drifts), times)])
    base = cameras[trusted] if trusted else _base(shown, devices[known], settled.covariance)
    reference = shown[base]
    offsets, drifts = np.zeros(len(names)), np.zeros(len(names))
    # (2 cameras, 2 devices) maps device states to camera states
    state = np.zeros((2 * len(names), 2 * count))
    for c in np.flatnonzero(known):
        i = int(devices[c])
        ratio = speed[base] / speed[i]
        apart = 1e-9 * (reference - shown[i])
        offsets[c], drifts[c] = ratio * apart, ratio - 1.0
        for device, sign in ((i, 1.0), (base, -1.0)):  # common = heard + offset + drift * since
            state[c, device] += sign
            state[c, count + device] += sign * apart
            state[len(names) + c, count + device] += sign
    covariance = state @ settled.covariance @ state.T
    unknown = np.flatnonzero(~known)
    covariance[unknown, unknown] = 0.1**2
    covariance[len(names) + unknown, len(names) + unknown] = 1e-4**2
    zero = np.zeros(len(names))
    windows = np.array([int(np.isfinite(settled.residuals[i]).sum()) if i >= 0 else 0 for i in devices])
    return CameraClocks(
        names,
        int(reference),
        offsets,
        drifts,
        covariance,
        known,
        0.0,
        zero,
        windows,
        0,
        True,
        np.zeros(len(names), bool),
        zero,
    )


def middles_of(
    settled: LineEstimate, times: Sequence[DeviceTime], cameras: Mapping[str, int], clocks: CameraClocks
) -> Array:
    """Return the times (C,) ns of `SoundClockEstimate.middles_ns`."""
    lines = settled.lines
    shown = _shown(lines.heard(np.array([lines.middle]))[:, 0], times, np.isfinite(lines.offsets))
    own = [
        shown[device] if known else clocks.reference_ns
        for device, known in zip(cameras.values(), clocks.known)
    ]
    return np.array(own, np.int64)


def _shown(heard: Array, times: Sequence[DeviceTime], linked: Array) -> list[int]:
    """Return the clock time (ns) of each device at its sample time `heard` (s); 0 if it is unknown."""
    return [
        time.start_ns + round(SECOND * float(at) * (1.0 + time.excess)) if there else 0
        for at, time, there in zip(heard, times, linked)
    ]


def _base(shown: Sequence[int], devices: Array, covariance: Array) -> int:
    """Return the index of the device whose clock is the reference."""
    ahead = int(devices[np.argmax([shown[i] for i in devices])])
    since = np.array([1e-9 * (shown[i] - shown[ahead]) for i in devices])
    variance = np.diag(covariance)[devices]
    best = np.zeros(len(devices), bool)
    for one, own in zip(since, variance):
        near = np.abs(since - one) <= np.maximum(AGREE, CHANCE * np.sqrt(own + variance))
        if near.sum() > best.sum():
            best = near
    if 2 * best.sum() <= len(devices):
        return ahead
    middle = np.median(since[best])
    return int(devices[best][np.argmin(np.abs(since[best] - middle))])
