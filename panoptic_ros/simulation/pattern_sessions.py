"""Simulated pictures of a random pattern that is projected onto tents inside a dome of cameras.

Each scene has other tents. A tent has two slopes, whose outer sides show the pattern. Cameras detect points
with white noise, if they look at the slope steeply enough.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.geometry import Intrinsics, Rigid

Array = np.ndarray
RADIUS = 2.75  # m, of the dome (Joo et al. 2017: diameter 5.49 m)
CENTRE_HEIGHT = 1.4  # m, of its centre
LOWEST = -0.4  # sine of the least elevation of a camera, seen from the centre
TERMS = (-0.25, 0.1, 0.001, 0.001, -0.01)  # distortion
CENTRE_SD = 8.0  # px, principal points
ASPECT_SD = 0.002  # relative difference of focal lengths
SPACE = np.array([[-1.1, -1.1, 0.3], [1.1, 1.1, 1.3]])  # m, middles of tents
TENT = (1.4, 0.6)  # m, length of the ridge and of a slope
TILT = (0.6, 1.1)  # rad, of a slope against the floor
STEEPEST = 0.35  # least cosine between the normal of a slope and the direction to a camera


class CameraModel(NamedTuple):
    """Cameras of one kind: their number, image size px, and focal length px."""

    number: int
    size: tuple[int, int]
    focal: float


VGA, HD, KINECT = (640, 480), (1920, 1080), (1920, 1080)
VGA_FOCAL, HD_FOCAL, KINECT_FOCAL = 745.0, 1400.0, 1050.0  # px


@dataclass(frozen=True)
class PatternScene:
    """Scene of a recording.

    Args:
        models: Cameras on the dome.
        scenes: Number of arrangements of the tents. tents: Number of tents in each.
        points: Number of points of the pattern in each scene.
        noise_px: White noise, px per axis.
        detected: Share of the visible points that a camera detects.
        outliers: Share of the pixels that are wrong by up to 20 px.
    """

    models: tuple[CameraModel, ...]
    scenes: int = 1
    tents: int = 3
    points: int = 1000
    noise_px: float = 0.3
    detected: float = 0.75
    outliers: float = 0.0


class PatternSession(NamedTuple):
    """Simulated recording.

    Args:
        rig: True cameras.
        positions: (B, 3) m, true points that two cameras detect, of all scenes.
        cameras, points: (M,) of each pixel, sorted by point, then camera. pixels: (M, 2) px.
    """

    rig: Rig
    positions: Array
    cameras: Array
    points: Array
    pixels: Array


def simulate_pattern(scene: PatternScene, seed: int) -> PatternSession:
    """Return the recording of a pattern."""
    rng = np.random.default_rng([seed, sum(model.number for model in scene.models)])
    rig = _dome(scene.models, rng)
    drawn = [_tents(scene, rng) for _ in range(scene.scenes)]
    positions = np.concatenate([own for own, _ in drawn])
    normals = np.concatenate([own for _, own in drawn])
    cameras, points, pixels = [], [], []
    for c, camera in enumerate(rig.cameras):
        own, front = camera.project(positions)
        towards = camera.centre - positions
        cosines = (towards * normals).sum(axis=1) / np.linalg.norm(towards, axis=1)
        with np.errstate(invalid="ignore"):
            inside = front & ((own > 0.0) & (own < np.array(camera.image_size))).all(axis=1)
        seen = np.flatnonzero(inside & (cosines > STEEPEST) & (rng.random(len(own)) < scene.detected))
        noisy = own[seen] + scene.noise_px * rng.standard_normal((len(seen), 2))
        wrong = rng.random(len(seen)) < scene.outliers
        noisy[wrong] += rng.uniform(-20.0, 20.0, (int(wrong.sum()), 2))
        cameras.append(np.full(len(seen), c))
        points.append(seen)
        pixels.append(noisy)
    own_camera, point, pixel = (np.concatenate(parts) for parts in (cameras, points, pixels))
    use = np.bincount(point, minlength=len(positions))[point] >= 2
    own_camera, point, pixel = own_camera[use], point[use], pixel[use]
    used, point = np.unique(point, return_inverse=True)
    order = np.lexsort([own_camera, point])
    return PatternSession(rig, positions[used], own_camera[order], point[order], pixel[order])


def _dome(models: tuple[CameraModel, ...], rng: np.random.Generator) -> Rig:
    """Return cameras at evenly spaced places of the dome (Fibonacci lattice), which look near its centre."""
    kinds = [model for model in models for _ in range(model.number)]
    order = rng.permutation(len(kinds))
    middle = np.array([0.0, 0.0, CENTRE_HEIGHT])
    cameras = []
    for c, kind in enumerate(kinds):
        height = LOWEST + (0.95 - LOWEST) * (order[c] + 0.5) / len(kinds)
        angle = order[c] * np.pi * (3.0 - np.sqrt(5.0))
        flat = np.sqrt(1.0 - height**2)
        position = middle + RADIUS * np.array([flat * np.cos(angle), flat * np.sin(angle), height])
        ahead = middle - [0.0, 0.0, 0.6] + 0.1 * rng.standard_normal(3) - position
        ahead = ahead / np.linalg.norm(ahead)
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        right = right / np.linalg.norm(right)
        rotation = np.stack([right, np.cross(ahead, right), ahead])
        focal = kind.focal * rng.uniform(0.97, 1.03)
        cx, cy = 0.5 * (np.array(kind.size) - 1) + CENTRE_SD * rng.standard_normal(2)
        aspect = 1.0 + ASPECT_SD * rng.standard_normal()
        matrix = np.array([[focal, 0.0, cx], [0.0, focal * aspect, cy], [0.0, 0.0, 1.0]])
        pose = Rigid(rotation, -rotation @ position)
        cameras.append(Camera(f"cam{c}", kind.size, Intrinsics(matrix, np.array(TERMS)), pose))
    return Rig(tuple(cameras))


def _tents(scene: PatternScene, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return random points (N, 3) m on the slopes of tents, and the normals (N, 3) of their slopes."""
    middles = rng.uniform(SPACE[0], SPACE[1], (scene.tents, 3))
    turns = rng.uniform(0.0, np.pi, scene.tents)
    tilts = rng.uniform(TILT[0], TILT[1], (scene.tents, 2))
    tent = rng.integers(scene.tents, size=scene.points)
    side = rng.integers(2, size=scene.points)
    along, down = rng.uniform(-0.5, 0.5, scene.points) * TENT[0], rng.uniform(0.0, TENT[1], scene.points)
    turn, tilt = turns[tent], tilts[tent, side]
    outward = np.stack([-np.sin(turn), np.cos(turn), np.zeros_like(turn)], axis=1) * (2 * side - 1)[:, None]
    ridge = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=1)
    up = np.array([0.0, 0.0, 1.0])
    slope = np.cos(tilt)[:, None] * outward - np.sin(tilt)[:, None] * up
    normals = np.sin(tilt)[:, None] * outward + np.cos(tilt)[:, None] * up
    return middles[tent] + along[:, None] * ridge + down[:, None] * slope, normals
