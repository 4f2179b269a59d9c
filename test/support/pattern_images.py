"""Images of a random pattern on walls before cameras, as folders of PNG files."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from panoptic_ros.calibration.pattern.artwork import CELL_M, random_pattern
from panoptic_ros.geometry import Rigid
from panoptic_ros.geometry.rotations import rotations_of
from test.support.board_images import SIZE, small_rig

WALL = (0.5, 0.5)  # m
ENLARGED = 8  # px of the texture per cell


def write_pattern_session(folder: Path, scenes: int, cameras: int = 4):
    """Write the images of all cameras, and return the rig. Each scene shows three walls side by side."""
    rig, rng = small_rig(cameras), np.random.default_rng(0)
    cells = random_pattern(3 * WALL[0], WALL[1])
    texture = np.where(np.kron(cells, np.ones((ENLARGED, ENLARGED))) > 0.0, 30, 220).astype(np.uint8)
    part = texture.shape[1] // 3
    for scene in range(scenes):
        walls = []
        for k in range(3):
            turn = rotations_of(rng.uniform([-0.4, -0.4, -0.3], [0.4, 0.4, 0.3])[None])[0]
            middle = np.array([0.45 * (k - 1), 0.0, 1.6]) + rng.uniform(-0.15, 0.15, 3)
            walls.append(
                (Rigid(turn, middle), np.roll(texture, 97 * scene, axis=0)[:, part * k : part * (k + 1)])
            )
        for camera in rig.cameras:
            image = np.full(SIZE[::-1], 120, np.uint8)
            for pose, printed in sorted(walls, key=lambda wall: -wall[0].translation[2]):
                _paint(image, camera, pose, printed)
            image = cv2.GaussianBlur(image, (0, 0), 0.7).astype(float) + 2.0 * rng.standard_normal(
                image.shape
            )
            (folder / camera.name).mkdir(parents=True, exist_ok=True)
            path = folder / camera.name / f"{scene:04d}.png"
            cv2.imwrite(str(path), np.clip(image, 0, 255).astype(np.uint8))
    return rig


def _paint(image, camera, pose, printed):
    """Paint a wall into an image."""
    height, width = printed.shape
    metres = CELL_M / ENLARGED
    flat = np.array(
        [[metres, 0, -0.5 * width * metres], [0, metres, -0.5 * height * metres], [0, 0, 0], [0, 0, 1.0]]
    )
    both = camera.cam_from_world.compose(pose)
    projection = camera.intrinsics.matrix @ np.column_stack([both.rotation, both.translation]) @ flat
    options = {"flags": cv2.INTER_AREA, "borderMode": cv2.BORDER_CONSTANT, "borderValue": 0}
    shown = cv2.warpPerspective(printed, projection, SIZE, **options)
    mask = cv2.warpPerspective(np.full_like(printed, 255), projection, SIZE, **options) > 127
    image[mask] = shown[mask]
