"""Simulated recordings of a flat board that a person shows to cameras, with exact truth.

The board moves smoothly or takes a new random pose at each instant. Each image of a camera may be late by an
offset and by a random time. Corners have white noise. The print is one-sided.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.geometry.rotations import rotations_of

Array = np.ndarray
SIZE = (1280, 720)  # px, images
FOCAL = 900.0  # px, mean focal length: a field of view of 71 degrees
FISHEYE_FOCAL = 400.0  # px: a field of view of 170 degrees
LENS = (-0.25, 0.08, 0.001, 0.001, -0.01)  # distortion of all cameras, typical for wide lenses
FISHEYE_LENS = (-0.02, 0.004, -0.001, 0.0002)
CENTRE_SD = 8.0  # px, principal points
ASPECT_SD = 0.002  # relative difference of focal lengths
AWAY = 3.0  # m, horizontal distance of the cameras from the middle
HEIGHT = 2.0  # m, of the cameras
SPACE = np.array([[-1.0, -1.0, 0.4], [1.0, 1.0, 1.8]])  # m, positions of the board
STEEPEST = 0.35  # least cosine between the board's normal and the direction to a camera that detects it
FEWEST = 6  # corners in an image
TURN_S = 6.0  # s, time of a turn of the board about the vertical in smooth motion


@dataclass(frozen=True)
class BoardScene:
    """Scene of a recording.

    Args:
        cameras: Number of cameras on a ring.
        instants: Number of instants.
        noise_px: White noise of the corners, px per axis.
        rate_hz: Rate, Hz, of all cameras.
        smooth: The board moves smoothly; else it takes a random pose at each instant.
        lag_s: Largest offset, s, of a camera's images. jitter_s: Standard deviation, s, of random lags.
        lens: Lens of all cameras.
        outliers: Share of the corners that are wrong by up to 20 px.
        all_round: Points are seen from all sides, as the markers of a wand; poses have any direction.
    """

    cameras: int
    instants: int
    noise_px: float = 0.3
    rate_hz: float = 6.0
    smooth: bool = False
    lag_s: float = 0.0
    jitter_s: float = 0.0
    lens: Literal["brown", "fisheye"] = "brown"
    outliers: float = 0.0
    all_round: bool = False


class SimulatedView(NamedTuple):
    """Board in one image: camera, instant, stamp s, point numbers (K,), pixels (K, 2)."""

    camera: int
    instant: int
    stamp_s: float
    numbers: Array
    pixels: Array


class BoardSession(NamedTuple):
    """Simulated recording.

    Args:
        rig: True cameras.
        views: All views of the board.
        offsets: (C,) s, true offsets: images are taken at their stamp plus the offset.
        shifts: (V,) s, random part of the lag of each view.
    """

    rig: Rig
    views: tuple[SimulatedView, ...]
    offsets: Array
    shifts: Array


def simulate_board(scene: BoardScene, points: Array, seed: int) -> BoardSession:
    """Return the recording of a board with points (N, 3) m, in its plane z = 0, x right and y down."""
    rng = np.random.default_rng([seed, scene.cameras, scene.instants])
    rig = _ring(scene, rng)
    offsets = rng.uniform(-scene.lag_s, scene.lag_s, scene.cameras)
    phases = rng.uniform(0.0, 2.0 * np.pi, (6, 2))
    drawn = [(rng.uniform(*SPACE), *_directions(rng)) for _ in range(scene.instants)]
    views, shifts = [], []
    for n in range(scene.instants):
        stamp = n / scene.rate_hz if scene.smooth else float(n)
        for c, camera in enumerate(rig.cameras):
            shift = scene.jitter_s * rng.standard_normal()
            pose = _smooth_pose(stamp + offsets[c] + shift, phases) if scene.smooth else _pose(*drawn[n])
            view = _seen(camera, pose, points, scene, rng)
            if view is not None:
                views.append(SimulatedView(c, n, stamp, *view))
                shifts.append(shift)
    return BoardSession(rig, tuple(views), offsets, np.array(shifts))


def _directions(rng: np.random.Generator) -> tuple[float, float, float]:
    """Return azimuth and elevation of the board's normal and its roll, rad."""
    return rng.uniform(0.0, 2.0 * np.pi), rng.uniform(-0.5, 0.7), rng.uniform(-0.5, 0.5)


def _pose(position: Array, azimuth: float, elevation: float, roll: float) -> Rigid:
    """Return the pose world from board; the board's side with the print has the normal -z."""
    flat = np.cos(elevation)
    normal = np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
    right = np.cross(normal, [0.0, 0.0, 1.0])
    right = -right / np.linalg.norm(right)
    down = np.cross(-normal, right)
    turn = rotations_of(np.array([[0.0, 0.0, roll]]))[0]
    return Rigid(np.stack([right, down, -normal], axis=1) @ turn, position)


def _smooth_pose(time_s: float, phases: Array) -> Rigid:
    """Return the pose of the board at a time: three slow oscillations, and a turn about the vertical."""
    speeds = np.array([0.9, 0.7, 1.1, 0.0, 0.8, 0.6])  # rad/s
    waves = np.sin(speeds * time_s + phases[:, 0])
    middle, half = SPACE.mean(axis=0), 0.5 * (SPACE[1] - SPACE[0])
    azimuth = phases[3, 1] + 2.0 * np.pi * time_s / TURN_S
    return _pose(middle + 0.8 * half * waves[:3], azimuth, 0.1 + 0.6 * waves[4], 0.5 * waves[5])


def _ring(scene: BoardScene, rng: np.random.Generator) -> Rig:
    cameras = []
    for c in range(scene.cameras):
        angle = 2.0 * np.pi * c / scene.cameras
        position = np.array([AWAY * np.cos(angle), AWAY * np.sin(angle), HEIGHT + rng.uniform(-0.4, 0.4)])
        ahead = np.array([0.0, 0.0, 1.0]) - position
        ahead = ahead / np.linalg.norm(ahead)
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        right = right / np.linalg.norm(right)
        rotation = np.stack([right, np.cross(ahead, right), ahead])
        focal = (FOCAL if scene.lens == "brown" else FISHEYE_FOCAL) * rng.uniform(0.9, 1.1)
        cx, cy = 0.5 * (np.array(SIZE) - 1) + CENTRE_SD * rng.standard_normal(2)
        aspect = 1.0 + ASPECT_SD * rng.standard_normal()
        matrix = np.array([[focal, 0.0, cx], [0.0, focal * aspect, cy], [0.0, 0.0, 1.0]])
        terms = np.array(LENS if scene.lens == "brown" else FISHEYE_LENS)
        intrinsics = Intrinsics(matrix, terms, scene.lens)
        cameras.append(Camera(f"cam{c}", SIZE, intrinsics, Rigid(rotation, -rotation @ position)))
    return Rig(tuple(cameras))


def _seen(
    camera: Camera, pose: Rigid, points: Array, scene: BoardScene, rng: np.random.Generator
) -> tuple[Array, Array] | None:
    """Return numbers and noisy pixels of the visible points; None if too few are visible."""
    middle = pose.apply(points.mean(axis=0))
    centre = camera.cam_from_world.inverse().translation
    towards = (centre - middle) / np.linalg.norm(centre - middle)
    if not scene.all_round and -pose.rotation[:, 2] @ towards < STEEPEST:
        return None
    pixels, front = camera.intrinsics.project(
        camera.cam_from_world.apply(pose.apply(points - points.mean(0)))
    )
    with np.errstate(invalid="ignore"):
        inside = front & ((pixels > 0.0) & (pixels < np.array(SIZE))).all(axis=1)
    if inside.sum() < min(FEWEST, len(points)):
        return None
    numbers = np.flatnonzero(inside)
    noisy = pixels[inside] + scene.noise_px * rng.standard_normal((len(numbers), 2))
    wrong = rng.random(len(numbers)) < scene.outliers
    noisy[wrong] += rng.uniform(-20.0, 20.0, (int(wrong.sum()), 2))
    return numbers, noisy
