"""Change of each camera against its own past, from sums of normal equations.

Detectors are biased, so the parameters that fit a camera best are not zero. The bias persists while the same
people walk in the same space. So the newest evidence is compared with that of the camera's own past.

A change is a chi-squared test with three degrees of freedom. The normal equations give the shape of the
covariance: a turn about the optical axis is about five times less certain than others. The scatter of earlier
comparisons gives its scale.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

Array = np.ndarray
PARAMETERS = 4  # rotation (rad), logarithm of the focal length
BLOCK_FRAMES = 3  # frames of a block
BLOCK_S = 0.6  # s of walking in a block
WINDOW = 5  # blocks of a window: 3 s of walking
OLDER, NEWER, ALL = slice(0, WINDOW), slice(WINDOW, None), slice(None)  # parts of the newest blocks
LOOKS = 2.0  # windows of past that a comparison needs
TURN, ZOOM = (0, 1, 2), (3,)  # parameters of the two kinds of changes
# Mean square of a parameter's change without a change, by the covariance of the normal equations: simulated
# detectors with a bias of 15 mm. It has the weight of two looks of 6 s.
SCATTER, SCATTER_LOOKS = 0.036, 2.0 * 2 * WINDOW
# Prior standard deviations: 1 deg and 3 % of the focal length. They bound estimates of a narrow view.
PRIOR = 1.0 / np.array([0.0175, 0.0175, 0.0175, 0.03]) ** 2
DIAGONAL = np.diag(PRIOR)


class NormalEquations(NamedTuple):
    """Normal equations (4, 4), (4,) of a camera's parameters."""

    normal: Array
    vector: Array

    def solution(self, kind: tuple[int, ...], spread: float | None = None) -> Array:
        """Return the parameters (K,) of one kind, the others being 0.

        Args:
            spread: Prior standard deviation of all of them; None = that of `PRIOR`.
        """
        chosen = list(kind)
        prior = PRIOR[chosen] if spread is None else np.full(len(chosen), spread**-2.0)
        solution: Array = np.linalg.solve(
            self.normal[np.ix_(chosen, chosen)] + np.diag(prior), self.vector[chosen]
        )
        return solution

    def gain(self, kind: tuple[int, ...]) -> float:
        """Return the decrease of the squared residuals by the solution of one kind."""
        return float(self.vector[list(kind)] @ self.solution(kind))


SUMS = (
    "normals vectors frames block_normals block_vectors blocks past_normals past_vectors looks expected "
    "gains recent squares counts"
)


class PastSums:
    """Sums of normal equations of C cameras: in the current block, in the newest blocks, and of the past."""

    def __init__(self, cameras: int):
        self.normals = np.zeros((cameras, PARAMETERS, PARAMETERS))  # current block
        self.vectors = np.zeros((cameras, PARAMETERS))
        self.frames = np.zeros(cameras, np.int64)
        self.block_normals = np.zeros((cameras, 2 * WINDOW, PARAMETERS, PARAMETERS))  # newest last
        self.block_vectors = np.zeros((cameras, 2 * WINDOW, PARAMETERS))
        self.blocks = np.zeros(cameras, np.int64)
        self.past_normals = np.zeros((cameras, PARAMETERS, PARAMETERS))
        self.past_vectors = np.zeros((cameras, PARAMETERS))
        self.looks = np.zeros(cameras)  # windows behind the past
        self.expected = np.zeros((cameras, PARAMETERS))  # parameters that fit the newest blocks
        self.gains = np.zeros((cameras, 2))  # decrease of the squared residuals by a turn, and by a zoom
        self.recent = np.full((cameras, 2 * WINDOW), np.nan)  # gains by a turn of the newest blocks
        self.squares = np.full(cameras, SCATTER * len(TURN) * SCATTER_LOOKS)  # sums of earlier gains
        self.counts = np.full(cameras, SCATTER_LOOKS)

    def close(self, keep: float) -> list[int]:
        """End the blocks that are complete, and return their cameras.

        Args:
            keep: Weight that the past keeps per block.
        """
        full = np.flatnonzero(self.frames >= BLOCK_FRAMES)
        if not len(full):
            return []
        old = full[self.blocks[full] == 2 * WINDOW]
        self.past_normals[old] = keep * self.past_normals[old] + self.block_normals[old, 0] / WINDOW
        self.past_vectors[old] = keep * self.past_vectors[old] + self.block_vectors[old, 0] / WINDOW
        self.looks[old] = keep * self.looks[old] + 1.0 / WINDOW
        self.block_normals[full, :-1] = self.block_normals[full, 1:]
        self.block_vectors[full, :-1] = self.block_vectors[full, 1:]
        self.block_normals[full, -1] = self.normals[full] / self.frames[full, None, None]
        self.block_vectors[full, -1] = self.vectors[full] / self.frames[full, None]
        self.blocks[full] = np.minimum(self.blocks[full] + 1, 2 * WINDOW)
        self.normals[full], self.vectors[full], self.frames[full] = 0.0, 0.0, 0
        normal = self.block_normals[full].sum(axis=1) / WINDOW + DIAGONAL
        vector = self.block_vectors[full].sum(axis=1) / WINDOW
        self.expected[full] = np.linalg.solve(normal, vector[..., None])[..., 0]
        self._compare(full)
        cameras: list[int] = full.tolist()
        return cameras

    def _compare(self, cameras: Array) -> None:
        """Compute all gains, and learn the scatter of cameras from gains before the newest blocks."""
        self.gains = self._all_gains()
        known = cameras[np.isfinite(self.recent[cameras, 0])]
        self.squares[known] += self.recent[known, 0]
        self.counts[known] += 1.0
        self.recent[cameras, :-1] = self.recent[cameras, 1:]
        self.recent[cameras, -1] = np.where(self.ready[cameras], self.gains[cameras, 0], np.nan)

    def restart(self, camera: int) -> None:
        """Forget the newest evidence of a camera, but not its past."""
        self.normals[camera], self.vectors[camera], self.frames[camera] = 0.0, 0.0, 0
        self.block_normals[camera], self.block_vectors[camera], self.blocks[camera] = 0.0, 0.0, 0
        self.recent[camera] = np.nan

    @property
    def ready(self) -> Array:
        """Return which cameras (C,) have two windows and a past."""
        ready: Array = (self.blocks == 2 * WINDOW) & (self.looks >= LOOKS)
        return ready

    def difference(self, camera: int, blocks: slice) -> NormalEquations:
        """Return the normal equations of the change of a camera in some of the newest blocks.

        The parameters of the past are eliminated.
        """
        normal = self.block_normals[camera, blocks].mean(axis=0)
        vector = self.block_vectors[camera, blocks].mean(axis=0)
        both = normal + self.past_normals[camera] + DIAGONAL
        share = np.linalg.solve(both, normal).T
        return NormalEquations(normal - share @ normal, vector - share @ (vector + self.past_vectors[camera]))

    @property
    def tests(self) -> Array:
        """Return chi-squared (C,) of a change of each camera in both windows; 0 = the camera is not ready."""
        tests: Array = len(TURN) * self.gains.max(axis=1) * self.counts / self.squares
        return tests

    def _all_gains(self) -> Array:
        """Return the decrease (C, 2) of the squared residuals by a turn and by a zoom in both windows.

        It is 0 for a camera that is not ready. The unit is the variance of a joint in one window: a bias that
        differs between joints counts as noise.
        """
        normal, vector = self.block_normals.mean(axis=1), self.block_vectors.mean(axis=1)[..., None]
        both = normal + self.past_normals + DIAGONAL
        share = np.linalg.solve(both, normal).swapaxes(1, 2)
        left = vector - share @ (vector + self.past_vectors[..., None])
        right = normal - share @ normal + DIAGONAL
        turn = (left[:, :3] * np.linalg.solve(right[:, :3, :3], left[:, :3])).sum(axis=(1, 2))
        zoom = left[:, 3, 0] ** 2 / right[:, 3, 3]
        gains: Array = np.where(self.ready[:, None], np.stack([turn, zoom], axis=1), 0.0)
        return gains


class CameraChange(NamedTuple):
    """Change of a camera against its past, by the more likely of two kinds.

    Args:
        is_zoom: Whether the focal length has changed, and not the rotation.
        change: (3,) rad rotation vector in the camera's axes, or (1,) logarithm of the focal lengths' ratio.
        size: Length of the change.
        agreed: The smaller of the windows' gains along the change, divided by that of both.
    """

    is_zoom: bool
    change: Array
    size: float
    agreed: float


def change_of(sums: PastSums, camera: int) -> CameraChange:
    """Return the change of a camera in its two windows."""
    both, older, newer = (sums.difference(camera, blocks) for blocks in (ALL, OLDER, NEWER))
    is_zoom = both.gain(ZOOM) > both.gain(TURN)
    kind = ZOOM if is_zoom else TURN
    change = both.solution(kind)
    size = max(float(np.linalg.norm(change)), 1e-9)
    chosen = list(kind)
    agreed = min(float(part.vector[chosen] @ change) for part in (older, newer)) / max(both.gain(kind), 1e-9)
    # A turn about the optical axis is uncertain. A prior of the size of the change keeps its noise out. Joint
    # biases mostly persist, so changes are about three times as certain as the normal equations state.
    return CameraChange(is_zoom, change if is_zoom else both.solution(kind, 3.0 * size), size, agreed)
