"""Black rectangles of a board's print, in metres."""

from __future__ import annotations

import cv2
import numpy as np

from panoptic_ros.calibration.board_detector import APRIL_BORDER
from panoptic_ros.calibration.boards import DICTIONARIES, Board

Array = np.ndarray


def black_rectangles(board: Board) -> Array:
    """Return the black rectangles (N, 4) m of a print: left, top, width, height."""
    if board.kind == "checkerboard":
        return _squares(board.columns + 1, board.rows + 1, board.size, np.zeros((0, 2)))
    dictionary = cv2.aruco.getPredefinedDictionary(DICTIONARIES[board.dictionary])
    if board.kind == "aprilgrid":
        return _april(board, dictionary)
    pattern = cv2.aruco.CharucoBoard((board.columns, board.rows), board.size, board.part, dictionary)
    pattern.setLegacyPattern(board.legacy)
    places = np.array([np.asarray(own)[0, :2] for own in pattern.getObjPoints()])
    inset = 0.5 * (board.size - board.part)
    parts = [_squares(board.columns, board.rows, board.size, (places - inset) / board.size)]
    for place, number in zip(places, np.ravel(pattern.getIds())):
        parts.append(_marker(dictionary, int(number), 1, board.part) + [place[0], place[1], 0.0, 0.0])
    return np.concatenate(parts)


def _squares(columns: int, rows: int, size: float, white: Array) -> Array:
    """Return the black squares of a chessboard; squares that hold markers are white."""
    marked = {(round(x), round(y)) for x, y in white}
    parity = (next(iter(marked))[0] + next(iter(marked))[1] + 1) % 2 if marked else 0
    return np.array(
        [
            [x * size, y * size, size, size]
            for y in range(rows)
            for x in range(columns)
            if (x + y) % 2 == parity
        ]
    )


def _marker(dictionary: cv2.aruco.Dictionary, number: int, border: int, side: float) -> Array:
    """Return the black modules (N, 4) m of a marker, each row's neighbours joined."""
    modules = dictionary.markerSize + 2 * border
    image = cv2.aruco.generateImageMarker(dictionary, number, modules, borderBits=border)
    module = side / modules
    found = []
    for y, row in enumerate(image < 128):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], row.astype(np.int8), [0]])))
        found += [
            [first * module, y * module, (last - first) * module, module]
            for first, last in zip(edges[::2], edges[1::2])
        ]
    return np.array(found)


def _april(board: Board, dictionary: cv2.aruco.Dictionary) -> Array:
    """Return the tags of a grid, the first at the lower left, and squares where their gaps meet."""
    pitch, gap = board.size + board.part, board.part
    parts = []
    for number in range(board.columns * board.rows):
        column, row = number % board.columns, board.rows - 1 - number // board.columns
        corner = [gap + column * pitch, gap + row * pitch, 0.0, 0.0]
        parts.append(_marker(dictionary, number, APRIL_BORDER, board.size) + corner)
    meets = [
        [column * pitch, row * pitch, gap, gap]
        for row in range(board.rows + 1)
        for column in range(board.columns + 1)
    ]
    return np.concatenate([*parts, np.array(meets)])
