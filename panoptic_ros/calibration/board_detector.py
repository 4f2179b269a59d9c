"""Corners of a board in images: sub-pixel positions, also of inverted and mirrored prints."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from panoptic_ros.calibration.boards import DICTIONARIES, Board

Array = np.ndarray
WINDOW = 5  # px, half width of the window of the sub-pixel refinement; less on small boards
WINDOW_SHARE = 0.3  # greatest half width of that window over the distance to the nearest corner
STEPS = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)
FEWEST = 4  # corners of a view
REPEATED = 2  # markers seen twice that prove two identical boards; texture repeats single ones
APRIL_BORDER = 2  # bits, black border of the tags of Kalibr's grids


class BoardAppearance(NamedTuple):
    """How a board appears in images: white on black, in a mirror or through its back."""

    inverted: bool
    mirrored: bool


class BoardSight(NamedTuple):
    """Board in one image.

    Args:
        numbers: (K,) points of the board, ascending. pixels: (K, 2) px.
        appearance: How the board appears.
        repeated: Number of markers that are seen twice. Two identical boards are ambiguous, so K is 0.
    """

    numbers: Array
    pixels: Array
    appearance: BoardAppearance
    repeated: int = 0


NOTHING = np.zeros(0, np.int64), np.zeros((0, 2))
APPEARANCES = tuple(BoardAppearance(i, m) for m in (False, True) for i in (False, True))


class BoardDetector:
    """Detector of one board.

    Args:
        board: the board.
        appearances: appearances to try, in this order.

    Attributes:
        partial: Numbers of corners and of markers in the last image, if it gave no view.
    """

    def __init__(self, board: Board, appearances: tuple[BoardAppearance, ...] = APPEARANCES):
        self.board, self.partial = board, (0, 0)
        self._order = list(appearances if board.kind != "checkerboard" else APPEARANCES[:1])
        if board.kind == "checkerboard":
            return
        parameters = cv2.aruco.DetectorParameters()
        dictionary = cv2.aruco.getPredefinedDictionary(DICTIONARIES[board.dictionary])
        if board.kind == "charuco":
            pattern = cv2.aruco.CharucoBoard((board.columns, board.rows), board.size, board.part, dictionary)
            pattern.setLegacyPattern(board.legacy)
            self._charuco = cv2.aruco.CharucoDetector(pattern, detectorParams=parameters)
        else:
            parameters.markerBorderBits = APRIL_BORDER
            self._markers = cv2.aruco.ArucoDetector(dictionary, parameters)

    def detect(self, image: Array) -> BoardSight | None:
        """Return the board in a grey image (H, W) uint8; None if fewer than four corners are found.

        The appearance of the last view is tried first.
        """
        self.partial = 0, 0
        for appearance in tuple(self._order):
            seen = 255 - image if appearance.inverted else image
            seen = np.ascontiguousarray(seen[:, ::-1]) if appearance.mirrored else seen
            numbers, pixels, markers = self._found(seen)
            repeated = _repeated(markers)
            if repeated < REPEATED and len(numbers) < FEWEST:
                self.partial = max(self.partial, (len(numbers), len(markers)))
                continue
            if appearance.mirrored:
                pixels[:, 0] = image.shape[1] - 1 - pixels[:, 0]
            self._order.remove(appearance)
            self._order.insert(0, appearance)
            return BoardSight(numbers, pixels, appearance, repeated if repeated >= REPEATED else 0)
        return None

    def _found(self, image: Array) -> tuple[Array, Array, Array]:
        """Return numbers, refined pixels, and markers (L,); without points if there are two boards."""
        find = {"charuco": self._charuco_corners, "checkerboard": self._corners, "aprilgrid": self._tags}
        numbers, pixels, markers = find[self.board.kind](image)
        if _repeated(markers) >= REPEATED:
            return *NOTHING, markers
        inside = (pixels >= 0.0).all(axis=1) & (pixels <= np.array(image.shape[1::-1]) - 1).all(axis=1)
        order = np.argsort(numbers[inside])
        numbers, pixels = numbers[inside][order], pixels[inside][order]
        return numbers, _refined(image, pixels) if len(pixels) >= FEWEST else pixels, markers

    def _charuco_corners(self, image: Array) -> tuple[Array, Array, Array]:
        corners, ids, _, markers = self._charuco.detectBoard(image)
        return *_arrays(ids, corners), NOTHING[0] if markers is None else markers.reshape(-1)

    def _corners(self, image: Array) -> tuple[Array, Array, Array]:
        size = (self.board.columns, self.board.rows)
        found, corners = cv2.findChessboardCornersSB(image, size, flags=cv2.CALIB_CB_ACCURACY)
        return *(_arrays(np.arange(size[0] * size[1]), corners) if found else NOTHING), NOTHING[0]

    def _tags(self, image: Array) -> tuple[Array, Array, Array]:
        corners, ids, _ = self._markers.detectMarkers(image)
        if ids is None:
            return *NOTHING, NOTHING[0]
        tags = ids.reshape(-1)
        count = self.board.columns * self.board.rows
        known = [(tag, np.reshape(own, (4, 2))) for tag, own in zip(tags, corners) if 0 <= tag < count]
        once = [(tag, own) for tag, own in known if np.sum(tags == tag) == 1]
        if len(once) < 2:
            return *NOTHING, tags
        pixels = np.concatenate([own for _, own in once]).astype(np.float64)
        # OpenCV before version 5 has tags turned by half a turn against AprilTag's own images
        numbered = [
            np.concatenate([4 * tag + np.roll(np.arange(4), turn) for tag, _ in once]) for turn in (0, 2)
        ]
        losses = [_homography_loss(self.board.points[numbers, :2], pixels) for numbers in numbered]
        return *_arrays(numbered[int(np.argmin(losses))], pixels), tags


def _arrays(numbers: Array | None, pixels: Array | None) -> tuple[Array, Array]:
    if numbers is None or pixels is None:
        return NOTHING
    return np.asarray(numbers, np.int64).reshape(-1), np.asarray(pixels, np.float64).reshape(-1, 2)


def _repeated(markers: Array) -> int:
    """Return the number of markers that are seen more than once."""
    return int((np.unique(markers, return_counts=True)[1] > 1).sum())


def _homography_loss(flat: Array, pixels: Array) -> float:
    """Return the root mean square px by which a homography of points (N, 2) misses pixels (N, 2)."""
    matrix, _ = cv2.findHomography(flat, pixels)
    if matrix is None:
        return float("inf")
    found = cv2.perspectiveTransform(flat[None], matrix)[0]
    return float(np.sqrt(np.mean((found - pixels) ** 2)))


def _refined(image: Array, pixels: Array) -> Array:
    """Return corners at the saddle points of the image, in a window that holds no other corner."""
    apart = np.linalg.norm(pixels[:, None] - pixels[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    window = int(min(WINDOW, WINDOW_SHARE * apart.min()))
    if window < 2:
        return pixels
    corners = pixels.astype(np.float32).reshape(-1, 1, 2).copy()
    refined = cv2.cornerSubPix(image, corners, (window, window), (-1, -1), STEPS).reshape(-1, 2)
    moved = np.linalg.norm(refined - pixels, axis=1) < window
    return np.where(moved[:, None], refined, pixels).astype(np.float64)
