"""Exact little scenes: cameras on a ring, people of 19 joints, keypoints and maps without any noise."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from panoptic_ros.domain import Camera, DetectionSet, Rig, ScoreMaps, ViewDetections
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.io.skeletons import load_skeleton

SKELETON = load_skeleton("panoptic19")
UPRIGHT = np.array(
    [
        [0.0, 0.0, 1.45],
        [0.12, 0.0, 1.55],
        [0.0, 0.0, 0.95],
        [0.0, 0.18, 1.42],
        [0.05, 0.25, 1.15],
        [0.2, 0.22, 0.95],
        [0.0, 0.1, 0.92],
        [0.03, 0.11, 0.5],
        [-0.02, 0.12, 0.08],
        [0.0, -0.18, 1.42],
        [0.02, -0.24, 1.16],
        [0.15, -0.3, 0.97],
        [0.0, -0.1, 0.92],
        [0.02, -0.11, 0.5],
        [-0.05, -0.12, 0.08],
        [0.1, 0.03, 1.6],
        [0.02, 0.08, 1.58],
        [0.1, -0.03, 1.6],
        [0.02, -0.08, 1.58],
    ]
)


def ring(count: int, lens: tuple[float, ...] | Intrinsics = (), radius: float = 4.0) -> Rig:
    """Cameras round the origin; lens: Brown's terms, or intrinsics that get another matrix."""
    straight = lens if isinstance(lens, Intrinsics) else Intrinsics(np.eye(3), np.array(lens))
    cameras = []
    for k in range(count):
        angle = 2.0 * np.pi * (k + 0.2) / count
        centre = np.array([radius * np.cos(angle), radius * np.sin(angle), 1.4 + 0.5 * (k % 3)])
        forward = np.array([0.0, 0.0, 0.9]) - centre
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        matrix = np.array([[500.0 + 7 * k, 0.5, 321.0], [0.0, 505.0 + 7 * k, 239.0], [0.0, 0.0, 1.0]])
        cameras.append(
            Camera(
                f"cam{k}", (640, 480), replace(straight, matrix=matrix), Rigid(rotation, -rotation @ centre)
            )
        )
    return Rig(tuple(cameras))


def person(x: float, y: float, turn: float = 0.0, size: float = 1.0) -> np.ndarray:
    c, s = np.cos(turn), np.sin(turn)
    return size * UPRIGHT @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + (x, y, 0.0)


def draw(points, scores, grid, affine, joints, persons=None, sigma=1.3, cut=0.05) -> ScoreMaps:
    """Gaussian patches round points (P, J, 2) px in cells; `persons`: their index, or all merged."""
    rows = []
    for i in range(len(points)):
        for j in joints:
            if scores[i, j] <= 0.0:
                continue
            at = affine[:, :2] @ points[i, j] + affine[:, 2]
            low = np.clip(np.floor(at).astype(int) - 4, 0, np.array(grid) - 1)
            high = np.clip(np.floor(at).astype(int) + 6, 1, grid)
            if (high <= low).any():
                continue
            x, y = np.arange(low[0], high[0]), np.arange(low[1], high[1])
            square = (x[None] - at[0]) ** 2 + (y[:, None] - at[1]) ** 2
            patch = scores[i, j] * np.exp(-square / (2.0 * sigma**2))
            patch = np.round(255.0 * np.where(patch >= cut, patch, 0.0)).astype(np.uint8)
            rows.append((j, -1 if persons is None else i, low, high - low, patch.ravel()))
    if not rows:
        return ScoreMaps(grid, affine, (), (), np.zeros((0, 2)), np.zeros((0, 2)), ())
    joint, owner, corner, size, data = zip(*rows)
    return ScoreMaps(grid, affine, joint, owner, np.array(corner), np.array(size), np.concatenate(data))


def detect(rig: Rig, people: list, maps: str = "none", score: float = 0.9) -> DetectionSet:
    """What a perfect detector sees. maps: none | merged | person | mixed (merged; none in every other view).

    Maps have no patches of Neck and BodyCenter, and another grid in every view.
    """
    views = []
    for v, camera in enumerate(rig.cameras):
        points, scores = np.zeros((len(people), 19, 2)), np.zeros((len(people), 19))
        for i, joints in enumerate(people):
            pixels, seen = camera.project(joints)
            seen &= camera.contains(pixels)
            points[i] = np.where(seen[:, None], pixels, np.nan)
            scores[i] = score * seen
        drawn = None
        if maps in ("merged", "person") or (maps == "mixed" and v % 2 == 0):
            cell = 5.0 + 0.5 * v
            grid = (int(660 / cell), int(500 / cell))
            affine = np.array([[1 / cell, 0.0, 0.3], [0.0, 1 / cell, 0.8]])
            names = [j for j in range(19) if j not in (0, 2)]
            owners = list(range(len(people))) if maps == "person" else None
            drawn = draw(points, scores, grid, affine, names, owners)
        views.append(
            ViewDetections(
                camera.name,
                1000,
                0,
                camera.image_size,
                SKELETON.hash,
                points,
                scores,
                np.full(len(people), score),
                drawn,
            )
        )
    return DetectionSet(0, 1000, SKELETON.hash, tuple(views))


@pytest.fixture(scope="session")
def scenes() -> SimpleNamespace:
    return SimpleNamespace(ring=ring, person=person, detect=detect, draw=draw, skeleton=SKELETON)
