"""Images of a board that moves before cameras, as folders of PNG files."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from panoptic_ros.calibration.board_artwork import black_rectangles
from panoptic_ros.calibration.boards import Board
from panoptic_ros.domain import Camera, Rig
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.geometry.rotations import rotations_of

PIXELS_PER_M = 2000.0
MARGIN_M = 0.02
SIZE = (640, 480)


def small_rig(count=3):
    """Return cameras without distortion in a row, 0.8 m apart, that look at a point 1.6 m away."""
    cameras = []
    for c in range(count):
        position = np.array([0.8 * (c - 0.5 * (count - 1)), 0.0, 0.0])
        ahead = np.array([0.0, 0.0, 1.6]) - position
        ahead /= np.linalg.norm(ahead)
        right = np.cross([0.0, 1.0, 0.0], ahead)
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(ahead, right), ahead])
        matrix = np.array([[560.0 + 10 * c, 0, 318.0], [0, 560.0 + 10 * c, 242.0], [0, 0, 1]])
        pose = Rigid(rotation, -rotation @ position)
        cameras.append(Camera(f"cam{c}", SIZE, Intrinsics(matrix, np.zeros(5)), pose))
    return Rig(tuple(cameras))


def board_poses(count, seed=0):
    """Return poses, world from the board's middle, in view of the cameras."""
    rng = np.random.default_rng(seed)
    poses = []
    for _ in range(count):
        turn = rotations_of(rng.uniform([-0.6, -0.6, -0.5], [0.6, 0.6, 0.5])[None])[0]
        poses.append(Rigid(turn, rng.uniform([-0.35, -0.25, 1.1], [0.35, 0.25, 1.8])))
    return poses


def artwork(board):
    """Return an image of the print on white paper."""
    width, height = board.extent
    image = np.full([round((side + 2 * MARGIN_M) * PIXELS_PER_M) for side in (height, width)], 255, np.uint8)
    for x, y, w, h in black_rectangles(board):
        rows = [round((v + MARGIN_M) * PIXELS_PER_M) for v in (y, y + h)]
        columns = [round((v + MARGIN_M) * PIXELS_PER_M) for v in (x, x + w)]
        image[rows[0] : rows[1], columns[0] : columns[1]] = 0
    return image


def photograph(camera: Camera, board: Board, pose: Rigid, printed, scale=(1.0, 1.0)):
    """Return the image of the print, whose sides are stretched by `scale`."""
    width, height = board.extent
    to_metres = np.array(
        [[1 / PIXELS_PER_M, 0, -MARGIN_M - width / 2], [0, 1 / PIXELS_PER_M, -MARGIN_M - height / 2]]
    )
    to_metres = np.diag(scale) @ to_metres
    flat = np.vstack([to_metres, [0, 0, 0], [0, 0, 1.0]])  # pixel to homogeneous point of the plane z = 0
    both = camera.cam_from_world.compose(pose)
    projection = camera.intrinsics.matrix @ np.column_stack([both.rotation, both.translation]) @ flat
    centred = projection @ np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1.0]])  # pixel centres of the print
    return cv2.warpPerspective(printed, centred, SIZE, flags=cv2.INTER_AREA, borderValue=128)


def write_session(folder: Path, board: Board, poses, rig=None, scale=(1.0, 1.0)):
    """Write the images of all cameras, and return the rig."""
    rig = rig or small_rig()
    printed = artwork(board)
    for camera in rig.cameras:
        (folder / camera.name).mkdir(parents=True)
        for n, pose in enumerate(poses):
            image = photograph(camera, board, pose, printed, scale)
            cv2.imwrite(str(folder / camera.name / f"{n:04d}.png"), image)
    return rig
