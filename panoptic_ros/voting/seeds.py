"""The sparse search: local maxima of eq. 1, looked for only where viewing rays of 2D peaks meet."""
from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from panoptic_ros.domain import Camera
from panoptic_ros.voting import kernels, ray_kernels
from panoptic_ros.voting.explaining import Explainer
from panoptic_ros.voting.image_peaks import find_peaks
from panoptic_ros.voting.scene import VoteScene
from panoptic_ros.voting.score_volume import Peaks, no_peaks, order_keys, sorted_peaks
from panoptic_ros.voting.volume import Volume

Array = np.ndarray
MEMORY_SLOTS = 1 << 16  # of the hash table of votes
PROMISE = 0.25  # a seed is climbed from if its vote is above this, relative to what a peak needs


class SeedSearch:
    """Finds peaks by seeds; holds the memory that is used again in every frame.

    Args:
        gap: m, largest distance between two rays that may be of one joint.
        pair_views: rays of at most so many views are paired.
        max_depth: m, largest distance of a seed from a camera.
    """

    def __init__(self, gap: float, pair_views: int, max_depth: float):
        self.gap, self.pair_views, self.max_depth = gap, pair_views, max_depth
        slots = MEMORY_SLOTS
        self._memory = (np.zeros(slots, np.int64), np.zeros(slots, np.int64), np.zeros(slots))

    def peaks(
        self,
        scene: VoteScene,
        cameras: Sequence[Camera],
        volume: Volume,
        threshold: float,
        view_threshold: float,
        enough: int,
        min_views: int,
    ) -> Peaks:
        """Local maxima as `dense_peaks` would find them, those that a seed of `min_views` rays leads to."""
        joints, points = self.seeds(scene, cameras, view_threshold, min_views)
        if not len(joints):
            return no_peaks()
        joints, voxels = _promising(scene, joints, points, volume, PROMISE * threshold)
        self._memory[1][:] = 0
        tops, ranks = kernels.climb(
            scene, joints, voxels, np.array(volume.lower), np.array(volume.upper),
            volume.side, view_threshold, enough, *self._memory,
        )  # fmt: skip
        climbed = ranks > 0.0
        top = sorted_peaks(Peaks(joints[climbed], tops[climbed], ranks[climbed], joints[climbed]))
        votes, support = kernels.vote_points(scene, top.joints, volume.centres(top.voxels), view_threshold)
        good = (votes > threshold) & (support >= enough)
        return Peaks(*(values[good] for values in (top.joints, top.voxels, votes, support)))

    def seeds(
        self,
        scene: VoteScene,
        cameras: Sequence[Camera],
        view_threshold: float,
        min_views: int = 2,
        known: Explainer | None = None,
    ) -> tuple[Array, Array]:
        """Joints (S,) and points (S, 3) m where rays of `min_views` (two or more) views meet.

        Args:
            known: what explains peaks that then give no seeds.
        """
        start, pixels = find_peaks(scene, view_threshold)
        if known is not None:
            start, pixels = known.unexplained(scene, start, pixels)
        joint_count = scene.map_start.shape[1]
        views, joints = np.divmod(np.repeat(np.arange(len(start) - 1), np.diff(start)), max(joint_count, 1))
        order = np.argsort(joints, kind="stable")
        joints, views = joints[order], views[order]
        rays = ray_kernels.pixel_rays(scene.cameras, views, pixels[order])
        starts = np.searchsorted(joints, np.arange(joint_count + 1))
        centres, paired = _places(tuple(cameras), self.pair_views)
        found: tuple[Array, Array] = ray_kernels.pair_seeds(
            centres, rays, views, starts, paired, self.gap, self.max_depth, max(min_views, 2)
        )
        return found


@lru_cache(maxsize=256)
def _places(cameras: tuple[Camera, ...], count: int) -> tuple[Array, Array]:
    """Where cameras are (V, 3), and which `count` of them are far from each other (V,)."""
    centres = np.array([camera.centre for camera in cameras]).reshape(-1, 3)
    return centres, spread(centres, count)


def _promising(
    scene: VoteScene, joints: Array, points: Array, volume: Volume, least: float
) -> tuple[Array, Array]:
    """Joints (S,) and voxels (S, 3) of the seeds in the volume, the best of each joint first.

    Seeds of one voxel become one; it is left out if the vote at their mean is not above `least`.
    """
    voxels = volume.voxels(points)
    inside = volume.contains(voxels)
    joints, points, voxels = joints[inside], points[inside], voxels[inside]
    _, first, which = np.unique(order_keys(joints, voxels), return_index=True, return_inverse=True)
    counts = np.bincount(which, minlength=len(first))
    sums = [np.bincount(which, weights=points[:, axis], minlength=len(first)) for axis in range(3)]
    joints, voxels = joints[first], voxels[first]
    votes, _ = kernels.vote_points(scene, joints, np.stack(sums, axis=-1) / counts[:, None], 1.0)
    order = np.lexsort([-votes, joints])
    order = order[votes[order] > least]
    return joints[order], voxels[order]


def spread(centres: Array, count: int) -> Array:
    """Which of the views (V,) to take so that `count` of them are far from each other.

    Starts with the one farthest from the middle and adds the farthest from those taken.
    """
    taken = np.ones(len(centres), bool)
    if len(centres) <= count:
        return taken
    taken[:] = False
    distance = np.linalg.norm(centres - centres.mean(axis=0), axis=1)
    for _ in range(count):
        farthest = int(np.argmax(distance))
        gaps = np.linalg.norm(centres - centres[farthest], axis=1)
        distance = gaps if not taken.any() else np.minimum(distance, gaps)
        taken[farthest] = True
        distance[taken] = -1.0
    return taken
