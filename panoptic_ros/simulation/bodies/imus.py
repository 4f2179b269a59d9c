"""Simulated IMU samples on a moving body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain.subjects import ImuSeries
from panoptic_ros.geometry.rotations import (
    from_quaternions,
    rotations_of,
    to_quaternions,
    turn_about_z,
    vectors_of,
)
from panoptic_ros.simulation.bodies.motion import BodyMotion

Array = np.ndarray
GRAVITY = np.array([0.0, 0.0, 9.81])


@dataclass(frozen=True)
class ImuNoise:
    """Errors of IMUs, as standard deviations in degrees and m/s^2 unless stated otherwise.

    Args:
        mounting: Error per axis of a mounting that a file states, deg.
        tissue: Rotation of the soft tissue under the strap, deg.
        tissue_share: Relative error of the acceleration caused by soft tissue.
        heading: Constant heading error, deg.
        heading_rate: Heading drift, deg/min.
        heading_wander: Slowly varying heading error, deg.
        tilt: Constant tilt error, deg.
        position: Error of the device position on its segment, m.
        acceleration: Noise of the accelerometer, m/s^2.
        rate: Noise of the gyroscope, rad/s.
    """

    mounting: float = 2.5
    tissue: float = 1.5
    tissue_share: float = 0.15
    heading: float = 1.5
    heading_rate: float = 1.0  # deg/min
    heading_wander: float = 1.0
    tilt: float = 0.6
    position: float = 0.015
    acceleration: float = 0.08
    rate: float = 0.01  # rad/s


def measure(
    rng: np.random.Generator,
    motion: BodyMotion,
    segment: int,
    position: Array,
    mount: Array,
    noise: ImuNoise,
    first_ns: int,
) -> ImuSeries:
    """Return the samples of one device at the times of the motion.

    Args:
        segment: Index of the segment that carries the device.
        position: Stated position (3,) m on the segment. The true position differs by noise.
        mount: True mounting (3, 3), segment from device.
        first_ns: Timestamp of the first sample.
    """
    times, frames = motion.times, motion.frames[:, segment]
    step = float(times[1] - times[0])
    where = position + noise.position * rng.normal(size=3)
    site = motion.places[:, segment] + frames @ where
    acceleration = np.gradient(np.gradient(site, step, axis=0), step, axis=0)
    acceleration[1:-1] = np.diff(site, 2, axis=0) / step**2
    soft = np.radians(noise.tissue) * _slow(rng, times, 0.5)
    heading = noise.heading * rng.normal() + noise.heading_rate * rng.normal() * times / 60.0
    heading = heading + noise.heading_wander * _slow(rng, times, 10.0)[:, 2]
    tilt = noise.tilt * rng.normal(size=2)
    world = np.column_stack([np.tile(tilt, (len(times), 1)), heading])
    true = frames @ rotations_of(soft) @ mount
    reported = rotations_of(np.radians(world)) @ true
    force = acceleration * (1.0 + noise.tissue_share * rng.normal(size=(len(times), 3))) + GRAVITY
    local = (true.swapaxes(1, 2) @ force[..., None])[..., 0] + noise.acceleration * rng.normal(
        size=force.shape
    )
    turned = vectors_of(np.ascontiguousarray(true[:-1].swapaxes(1, 2) @ true[1:])) / step
    rates = np.concatenate([turned, turned[-1:]]) + noise.rate * rng.normal(size=force.shape)
    stamps = first_ns + np.round(times * 1e9).astype(np.int64)
    return ImuSeries(stamps, to_quaternions(reported), rates, local)


def random_mount(rng: np.random.Generator) -> Array:
    """Return a random rotation (3, 3)."""
    axis = rng.normal(size=3)
    found: Array = rotations_of((axis / np.linalg.norm(axis) * rng.uniform(0, np.pi))[None])[0]
    return found


def mistaken(rng: np.random.Generator, mount: Array, degrees: float) -> Array:
    """Return a mounting as a file states it, with an error of `degrees` per axis (standard deviation)."""
    found: Array = rotations_of(np.radians(degrees) * rng.normal(size=(1, 3)))[0] @ mount
    return found


def unknown_heading(series: ImuSeries, angle: float) -> ImuSeries:
    """Return the series in an inertial frame that is rotated about the vertical by `angle` rad."""
    turned = turn_about_z(-angle) @ from_quaternions(series.quaternions)
    return ImuSeries(series.stamps, to_quaternions(turned), series.rates, series.forces)


def _slow(rng: np.random.Generator, times: Array, period: float) -> Array:
    """Return smooth random numbers (T, 3) of variance 1 with a period of about `period` s."""
    speed = 2 * np.pi / period * rng.uniform(0.5, 2.0, (6, 3))
    phase = rng.uniform(0, 2 * np.pi, (6, 3))
    found: Array = np.sin(times[:, None, None] * speed + phase).sum(1) / np.sqrt(3.0)
    return found
