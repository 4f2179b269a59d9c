"""The sparse search: local maxima of eq. 1, looked for only where viewing rays of 2D peaks meet."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from panoptic_ros.domain import Camera
from panoptic_ros.voting import kernels, map_kernels, ray_kernels
from panoptic_ros.voting.explaining import Explainer
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
        joint_count = scene.map_start.shape[1]
        start, pixels = find_peaks(scene, view_threshold)
        if known is not None:
            start, pixels = known.unexplained(scene, start, pixels)
        if len(pixels) < min_views:
            return np.zeros(0, np.int64), np.zeros((0, 3))
        views = np.repeat(np.arange(len(start) - 1) // max(joint_count, 1), np.diff(start))
        rays = ray_kernels.pixel_rays(scene.cameras, views, pixels)
        centres = np.array([camera.centre for camera in cameras]).reshape(-1, 3)
        paired = spread(centres, self.pair_views)
        size = 1024
        while True:
            joints, points = np.zeros(size, np.int64), np.zeros((size, 3))
            total = ray_kernels.pair_seeds(
                centres, rays, start, paired, joint_count, self.gap, self.max_depth, max(min_views, 2),
                joints, points,
            )  # fmt: skip
            if total <= size:
                return joints[:total], points[:total]
            size = total


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


def find_peaks(scene: VoteScene, threshold: float) -> tuple[Array, Array]:
    """2D peaks of all views and joints above a threshold.

    3x3 local maxima of the maps, and the keypoints of joints without maps.

    Returns:
        start (V * J + 1), the first peak of (v, j) being start[v * J + j]; pixels (K, 2).
    """
    views, joint_count, _, _ = scene.people.shape
    maps = (scene.map_start, scene.map_data, scene.cameras[:, 25:27].astype(np.int64))
    patches = (scene.patch_start, scene.patch_table, scene.patch_data)
    counts = np.zeros(views * joint_count, np.int64)
    cells = np.zeros((max(1024, 2 * len(scene.patch_table)), 2), np.int64)
    total = map_kernels.count_map_peaks(*maps, *patches, threshold, counts, cells)
    if total > len(cells):
        cells = np.zeros((total, 2), np.int64)
        map_kernels.count_map_peaks(*maps, *patches, threshold, counts, cells)
    places = map_kernels.peak_centroids(*maps, counts, cells[:total])
    affine = scene.cameras[:, 27:33].reshape(views, 2, 3)
    view = np.repeat(np.arange(len(counts)) // max(joint_count, 1), counts)
    inverse = np.zeros((views, 2, 2))
    has_maps = maps[2][:, 0] > 0
    inverse[has_maps] = np.linalg.inv(affine[has_maps, :, :2])
    from_maps = np.einsum("kij,kj->ki", inverse[view], places - affine[view, :, 2])

    known = (scene.people[..., 3] > threshold) & (scene.map_start < 0)[..., None]
    from_people = scene.people[known][:, :2]
    people = known.sum(axis=2).ravel()
    key = np.arange(len(counts))
    keys = np.concatenate([np.repeat(key, counts), np.repeat(key, people)])
    order = np.argsort(keys, kind="stable")
    start = np.concatenate([[0], np.cumsum(counts + people)])
    return start, np.concatenate([from_maps, from_people])[order]


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
