"""Heading and clock of IMUs from motion: the angular velocity of a bone is the same, however a device sits
on it.

Cameras see how a bone turns but for the turn about itself, so only what is perpendicular to the bone is
compared.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d

from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.domain.subjects import BodyState, Subject, TPose
from panoptic_ros.geometry.rotations import mean_rotation, turn_about_z, vectors_of
from panoptic_ros.kinematics.config import KinematicsConfig

Array = np.ndarray
SMOOTHING_S = 0.06  # of angular velocities, about 3 Hz
OFFSETS_S = np.arange(-0.15, 0.1501, 0.005)
LEAST_MOTION = 0.3  # rad/s, root mean square of what is compared: less tells nothing
HEADINGS = 720
ALIGNED_LAG_S = 0.2  # of the poses that are compared: with less, they follow late and look like a late clock
LEAST_OFFSET_S, SURE = 0.012, 3.0  # s, standard deviations: less is within the error of finding it
SAME_S = 1.0  # for which errors of angular velocities stay the same


_Pair = tuple[Array, Array, Array, Array]  # see `align`


class Alignment(NamedTuple):
    """Heading, rad, world from inertial frame; offset, s, that is added to the stamps of the IMUs, and its
    standard deviation; root mean square, rad/s, of what is compared, and of what is left of it."""

    heading: float
    offset: float
    unsure: float
    motion: float
    residual: float

    @property
    def late(self) -> bool:
        """Whether the clock is off by more than the error of finding it."""
        return abs(self.offset) >= max(LEAST_OFFSET_S, SURE * self.unsure)


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
    pairs: list[_Pair] = []  # stamps, felt (N, 3); seen (T, 3), and what is across the bone (T, 3, 3)
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
    offset, heading, left, unsure = float(OFFSETS_S[k]), found[k][1], max(float(costs[k]), 0.0), math.inf
    if 0 < k < len(costs) - 1:
        spacing = float(OFFSETS_S[1] - OFFSETS_S[0])
        bend = float(costs[k - 1] - 2 * costs[k] + costs[k + 1]) / spacing**2
        offset += float(0.5 * (costs[k - 1] - costs[k + 1])) / (bend * spacing)
        independent = max(len(pairs) * len(states) * step / SAME_S, 1.0)
        unsure = math.sqrt(2.0 * left / (bend * independent))
    return Alignment(heading, offset, unsure, motion, math.sqrt(left))


def _fit(
    stamps: Array, pairs: list[_Pair], offset: float, known: bool
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


def cameras_alone(config: KinematicsConfig) -> KinematicsConfig:
    """How motion is solved that is compared with what IMUs felt."""
    return replace(config, lag=ALIGNED_LAG_S)


def taken_over(subject: Subject, found: Alignment, clocks: bool) -> tuple[float, int, list[str]]:
    """Heading, rad, what is added to the stamps of the IMUs, ns, and lines about both where they are not as
    stated.

    Args:
        clocks: whether an offset of the clock is taken over.
    """
    heading, offset_ns, lines = 0.0, 0, []
    if not subject.heading_known:
        heading = found.heading
        lines.append(f"heading of the IMUs found from motion: {math.degrees(heading):.1f} deg")
    if clocks and found.late:
        offset_ns = round(1e9 * found.offset)
        lines.append(f"clock of the IMUs found from motion: {1e3 * found.offset:+.0f} ms")
    return heading, offset_ns, lines


def t_pose_mount(pose: TPose, heading: float, held: Sequence[Array]) -> Array:
    """Mounting (3, 3), segment from device, of a device with these orientations (3, 3) in a T-pose.

    Args:
        heading: rad, world from the IMUs' inertial frame.
    """
    facing = pose.facing if pose.facing is not None else np.array([1.0, 0.0, 0.0])
    body = turn_about_z(float(np.arctan2(facing[1], facing[0])))
    found: Array = body.T @ turn_about_z(heading) @ mean_rotation(np.array(held))
    return found
