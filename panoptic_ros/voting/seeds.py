"""The sparse search: local maxima of eq. 1, looked for only where viewing rays of 2D peaks meet."""
from __future__ import annotations

from functools import lru_cache

import numpy as np

from panoptic_ros.voting import kernels, ray_kernels
from panoptic_ros.voting.explaining import Explainer
from panoptic_ros.voting.image_peaks import find_peaks
from panoptic_ros.voting.peaks import Demands, Peaks, no_peaks, order_keys, sorted_peaks
from panoptic_ros.voting.scene import VoteScene
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
        keys, epochs = np.zeros((2, MEMORY_SLOTS), np.int64)
        self._memory = kernels.VoteMemory(keys, epochs, np.zeros(MEMORY_SLOTS))

    def peaks(self, scene: VoteScene, volume: Volume, wanted: Demands) -> Peaks:
        """Local maxima as `BoxSearch` would find them, those that a seed of enough rays leads to."""
        joints, points = self.seeds(scene, wanted)
        if not len(joints):
            return no_peaks()
        joints, voxels = _promising(scene, joints, points, volume, PROMISE * wanted.threshold)
        self._memory.epochs[:] = 0
        tops, ranks = kernels.climb(scene, joints, voxels, volume, wanted, self._memory)
        climbed = ranks > 0.0
        top = sorted_peaks(Peaks(joints[climbed], tops[climbed], ranks[climbed], joints[climbed]))
        votes, support = kernels.vote_points(
            scene, top.joints, volume.centres(top.voxels), wanted.view_threshold
        )
        good = (votes > wanted.threshold) & (support >= wanted.enough)
        return top._replace(votes=votes, support=support).rows(good)

    def seeds(
        self, scene: VoteScene, wanted: Demands, known: Explainer | None = None
    ) -> tuple[Array, Array]:
        """Joints (S,) and points (S, 3) m where rays of `wanted.min_views` (two or more) views meet.

        Args:
            known: what explains peaks that then give no seeds.
        """
        peaks = find_peaks(scene, wanted.view_threshold)
        if known is not None:
            peaks = known.unexplained(scene, peaks)
        centres = np.stack([scene.cameras["ox"], scene.cameras["oy"], scene.cameras["oz"]], axis=-1)
        paired = _paired(centres.tobytes(), self.pair_views)
        meeting = ray_kernels.Meeting(self.gap, self.max_depth, max(wanted.min_views, 2), paired)
        found: tuple[Array, Array] = ray_kernels.pair_seeds(scene, peaks, meeting)
        return found


@lru_cache(maxsize=256)
def _paired(centres: bytes, count: int) -> Array:
    """Which `count` views are far from each other (V,), of the centres (V, 3) m of all."""
    return spread(np.frombuffer(centres).reshape(-1, 3), count)


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
