"""An information filter of the clocks over blocks of motion, with slow forgetting."""

from __future__ import annotations

import numpy as np

from panoptic_ros.offsets.estimate import centred

Array = np.ndarray
JUMP = 6.0  # standard deviations of an innovation, beyond which a clock has jumped
LEAST_JUMP = 3e-3  # s; less is no jump
VAGUE = 1e-3  # of the prior's information, added so that the information of a block can be inverted


class ClockFilter:
    """An information filter of (offsets in s at the newest reference, drifts), 2C states.

    Args:
        prior: (2C,) standard deviations about 0, which are not forgotten. memory_s: see `OffsetsConfig`.
    """

    def __init__(self, cameras: int, prior: Array, memory_s: float):
        self._cameras, self._prior, self._memory = cameras, prior, memory_s
        self._information = np.zeros((2 * cameras, 2 * cameras))
        self._vector = np.zeros(2 * cameras)

    def move(self, seconds: float) -> None:
        """Predict: the reference moves ahead, and information fades."""
        back = np.eye(2 * self._cameras)
        back[: self._cameras, self._cameras :] = -seconds * np.eye(self._cameras)
        fade = np.exp(-seconds / self._memory)
        self._information = fade * back.T @ self._information @ back
        self._vector = fade * back.T @ self._vector

    def add(self, state: Array, information: Array) -> Array:
        """Update with the estimate (2C,) of a block and its information (2C, 2C).

        What was known of a camera whose clock has jumped is forgotten first. As the jump may lie anywhere in
        the block, the block then tells the offset of that camera to half of the jump only.

        Returns:
            How far (C,) s clocks have jumped against the others, 0 where they have not.
        """
        jumps = np.zeros(self._cameras)
        for _ in range(self._cameras // 2):  # more could not be told from jumps of the others
            camera, jump = self._jump(state, information)
            if jump == 0.0:
                break
            jumps[camera] += jump
            self._forget(camera)
            information = _less_sure(information, camera, 0.5 * jump)
        self._information = self._information + information
        self._vector = self._vector + information @ state
        return jumps

    def state(self) -> tuple[Array, Array]:
        """Estimate (2C,) with mean 0, and covariance (2C, 2C) about the mean."""
        covariance = np.linalg.inv(self._information + np.diag(self._prior**-2.0))
        gauge = np.kron(np.eye(2), np.eye(self._cameras) - 1.0 / self._cameras)
        return centred(covariance @ self._vector, self._cameras), gauge @ covariance @ gauge.T

    def _jump(self, state: Array, information: Array) -> tuple[int, float]:
        """The camera whose jump explains most of the innovation of a block, and the jump.

        The test is that of a shift of one offset in an innovation of known covariance, without what all
        cameras share.
        """
        count = self._cameras
        before, spread = self.state()
        block = np.linalg.inv(information + np.diag(VAGUE * self._prior**-2.0))[:count, :count]
        gauge = np.eye(count) - 1.0 / count
        weight = np.linalg.pinv(gauge @ block @ gauge.T + spread[:count, :count], rcond=1e-9, hermitian=True)
        pull = weight @ (centred(state, count) - before)[:count]
        sure = np.maximum(np.diag(weight), 1e-12)
        camera = int((pull**2 / sure).argmax())
        jump = float(pull[camera] / sure[camera])
        if pull[camera] ** 2 < JUMP**2 * sure[camera] or abs(jump) < LEAST_JUMP:
            return camera, 0.0
        return camera, jump

    def _forget(self, camera: int) -> None:
        """Marginalise a camera out: what is known of the others without it stays."""
        for k in (camera, self._cameras + camera):
            if self._information[k, k] > 0.0:
                share = self._information[k] / self._information[k, k]
                self._vector = self._vector - share * self._vector[k]
                self._information = self._information - np.outer(share, self._information[k])
            self._information[k, :] = self._information[:, k] = self._vector[k] = 0.0


def _less_sure(information: Array, k: int, deviation: float) -> Array:
    """Information after an independent error with this standard deviation is added to state `k`."""
    column = information[:, k]
    reduced: Array = information - np.outer(column, column) / (deviation**-2.0 + column[k])
    return reduced
