"""What blocks of motion say about the clocks, added up with slow forgetting."""
from __future__ import annotations

import numpy as np

from panoptic_ros.offsets.estimate import centred

Array = np.ndarray


class ClockFilter:
    """An information filter of (offsets in s at the newest reference, drifts), 2C states.

    Args:
        prior: (2C,) standard deviations about 0 that never go away. memory_s: see `OffsetsConfig`.
    """

    def __init__(self, cameras: int, prior: Array, memory_s: float):
        self._cameras, self._prior, self._memory = cameras, prior, memory_s
        self._information = np.zeros((2 * cameras, 2 * cameras))
        self._vector = np.zeros(2 * cameras)

    def move(self, seconds: float) -> None:
        """Let time pass: the reference moves on, and what is known fades."""
        back = np.eye(2 * self._cameras)
        back[: self._cameras, self._cameras :] = -seconds * np.eye(self._cameras)
        fade = np.exp(-seconds / self._memory)
        self._information = fade * back.T @ self._information @ back
        self._vector = fade * back.T @ self._vector

    def add(self, state: Array, information: Array) -> None:
        """Take the estimate (2C,) of a block and its information (2C, 2C)."""
        self._information = self._information + information
        self._vector = self._vector + information @ state

    def state(self) -> tuple[Array, Array]:
        """Estimate (2C,) with mean 0, and covariance (2C, 2C) about the mean."""
        covariance = np.linalg.inv(self._information + np.diag(self._prior**-2.0))
        gauge = np.kron(np.eye(2), np.eye(self._cameras) - 1.0 / self._cameras)
        return centred(covariance @ self._vector, self._cameras), gauge @ covariance @ gauge.T
