"""Soft shadows of people on the floor, drawn into a map of the floor seen from above."""

from __future__ import annotations

import cv2
import numpy as np

from panoptic_ros.simulation.rendering.paint import LIGHT
from panoptic_ros.simulation.skeleton import SKELETON, J

Array = np.ndarray
CELLS = 256
KEY, CONTACT = 0.80, 0.62  # brightness in the shadow of the light, and under people
SOFT_KEY, SOFT_CONTACT = 1.5, 2.2  # cells
_BONES = [(a, b) for a, b in SKELETON.bones if J["lEye"] not in (a, b) and J["rEye"] not in (a, b)]


class Floor:
    """A square of 2 * `half` m round the origin in CELLS x CELLS cells."""

    def __init__(self, half: float):
        self._scale, self._half = (CELLS - 1) / (2.0 * half), half

    def cells(self, places: Array) -> Array:
        """Cell coordinates (..., 2) of places (..., 2) m."""
        return (places + self._half) * self._scale

    def shade(self, joints: Array) -> Array:
        """Brightness (CELLS, CELLS) float32 for people with joints (P, 19, 3) m."""
        key, contact = np.ones((CELLS, CELLS), np.float32), np.ones((CELLS, CELLS), np.float32)
        thrown = joints[..., :2] - joints[..., 2:] * (LIGHT[:2] / LIGHT[2])
        for place, points in zip(thrown, joints):
            cells = np.rint(self.cells(place)).astype(int).tolist()
            for a, b in _BONES:
                cv2.line(key, cells[a], cells[b], KEY, self._cells(0.14))
            below = np.rint(self.cells(points[..., :2])).astype(int).tolist()
            for name, radius in (("lAnkle", 0.13), ("rAnkle", 0.13), ("BodyCenter", 0.20)):
                cv2.circle(contact, below[J[name]], self._cells(radius), CONTACT, -1)
        soft = cv2.GaussianBlur(key, (0, 0), SOFT_KEY)
        return soft * cv2.GaussianBlur(contact, (0, 0), SOFT_CONTACT)

    def _cells(self, metres: float) -> int:
        return max(1, round(metres * self._scale))
