"""Heading and clock of IMUs from motion: the angular velocity of a bone is the same, however a device sits
on it.

Cameras see how a bone turns but for the turn about itself, so only what is perpendicular to the bone is
compared.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d

from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.domain.subjects import BodyState, Subject
from panoptic_ros.geometry.rotations import vectors_of

Array = np.ndarray
SMOOTHING_S = 0.06  # of angular velocities, about 3 Hz
OFFSETS_S = np.arange(-0.15, 0.1501, 0.005)
LEAST_MOTION = 0.3  # rad/s, root mean square of what is compared: less tells nothing
HEADINGS = 720


class Alignment(NamedTuple):
    """Heading, rad, world from inertial frame; offset, s, that is added to the stamps of the IMUs; root mean
    square, rad/s, of what is compared, and of what is left of it."""

    heading: float
    offset: float
    motion: float
    residual: float


def align(
    subject: Subject, states: Sequence[BodyState], orientations: dict[str, tuple[Array, Array]]
) -> Alignment | None:
    """How the IMUs of a subject lie in the world and in time; None if the body hardly moves.

    Args:
        states: solved from cameras alone, at a fixed rate.
        orientations: stamps (N,) ns and rotations (N, 3, 3), inertial frame from device, by device.
    """
    if len(states) < 10:
        return None
    stamps = np.array([state.stamp_ns for state in states])
    frames = np.array([state.frames for state in states])
    step = float(np.median(np.diff(stamps))) * 1e-9
    pairs = []
    for device in subject.devices:
        bone = _bone(subject.body.model, device.segment)
        if device.name not in orientations or bone is None:
            continue
        seen = _velocities(frames[:, device.segment], step)
        when, turned = orientations[device.name]
        felt = _velocities(turned, float(np.median(np.diff(when))) * 1e-9)
        axis = frames[:, device.segment] @ (
            subject.body.offsets[bone] / np.linalg.norm(subject.body.offsets[bone])
        )
        across = np.eye(3) - axis[:, :, None] * axis[:, None, :]
        pairs.append((when, felt, (across @ seen[..., None])[..., 0], across))
    if not pairs:
        return None
    motion = math.sqrt(float(np.mean([(p[2] ** 2).sum(-1).mean() for p in pairs])))
    if motion < LEAST_MOTION:
        return None
    found = [_fit(stamps, pairs, offset, subject.heading_known) for offset in OFFSETS_S]
    costs = np.array([cost for cost, _ in found])
    k = int(np.argmin(costs))
    offset, heading = float(OFFSETS_S[k]), found[k][1]
    if 0 < k < len(costs) - 1:
        bend = costs[k - 1] - 2 * costs[k] + costs[k + 1]
        offset += float(0.5 * (costs[k - 1] - costs[k + 1]) / bend * (OFFSETS_S[1] - OFFSETS_S[0]))
    return Alignment(heading, offset, motion, math.sqrt(max(float(costs[k]), 0.0)))


def _fit(
    stamps: Array, pairs: list[tuple[Array, Array, Array, Array]], offset: float, known: bool
) -> tuple[float, float]:
    """Mean square that is left, and the heading, for an offset of the clock."""
    matrix, vector, constant, count = np.zeros((2, 2)), np.zeros(2), 0.0, 0
    for when, felt, seen, across in pairs:
        at = stamps - offset * 1e9
        inside = (at > when[0]) & (at < when[-1])
        there = np.stack([np.interp(at[inside], when, felt[:, j]) for j in range(3)], axis=-1)
        level = np.column_stack([there[:, :2], np.zeros(len(there))])
        turned = np.column_stack([-there[:, 1], there[:, 0], np.zeros(len(there))])
        upright = np.column_stack([np.zeros((len(there), 2)), there[:, 2]])
        p = across[inside]
        a, b = (p @ level[..., None])[..., 0], (p @ turned[..., None])[..., 0]
        rest = seen[inside] - (p @ upright[..., None])[..., 0]
        matrix += np.array([[(a * a).sum(), (a * b).sum()], [(a * b).sum(), (b * b).sum()]])
        vector += np.array([(a * rest).sum(), (b * rest).sum()])
        constant += float((rest**2).sum())
        count += len(there)
    angles = np.zeros(1) if known else 2.0 * np.pi * np.arange(HEADINGS) / HEADINGS - np.pi
    turns = np.stack([np.cos(angles), np.sin(angles)])
    costs = (turns * (matrix @ turns)).sum(0) - 2.0 * vector @ turns + constant
    k = int(np.argmin(costs))
    return float(costs[k]) / max(count, 1), float(angles[k])


def _velocities(rotations: Array, step: float) -> Array:
    """Angular velocity (T, 3) rad/s in the world of rotations (T, 3, 3), smoothed."""
    turned = vectors_of(np.ascontiguousarray(rotations[2:] @ rotations[:-2].swapaxes(1, 2))) / (2.0 * step)
    padded = np.concatenate([turned[:1], turned, turned[-1:]])
    found: Array = gaussian_filter1d(padded, SMOOTHING_S / step, axis=0)
    return found


def _bone(model: SegmentModel, segment: int) -> int | None:
    """The segment at the end of the bone of a limb's segment; None for the trunk, head, hands and feet."""
    children = np.flatnonzero(model.parents == segment)
    name = model.names[segment]
    if len(children) != 1 or name[:1] not in "lr" or model.parents[segment] < 0:
        return None
    return int(children[0])
