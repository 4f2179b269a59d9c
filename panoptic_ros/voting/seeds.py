"""The sparse search: nodes where viewing rays of 2D peaks meet."""
from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from panoptic_ros.voting import kernels, ray_kernels
from panoptic_ros.voting.explaining import Explainer, moved
from panoptic_ros.voting.image_peaks import find_peaks
from panoptic_ros.voting.proposals import Demands, Nodes, distinct, no_nodes
from panoptic_ros.voting.scene import VoteScene

Array = np.ndarray
SPACING = 0.12  # m, of the seeds of a joint that are followed
PROMISE = 0.9  # a seed is followed if its vote is above this, relative to what a node needs


class SeedSearch(NamedTuple):
    """Finds nodes from seeds.

    Args:
        gap: m, largest distance between two rays that may be of one joint.
        pair_views: rays of at most so many views are paired.
        max_depth: m, largest distance of a seed from a camera.
    """

    gap: float
    pair_views: int
    max_depth: float

    def nodes(self, scene: VoteScene, wanted: Demands, known: Explainer) -> Nodes:
        """Nodes at seeds, moved to the centre of the votes about them.

        Of seeds of one joint that are close to each other only that with most votes is followed.
        """
        joints, points = self.seeds(scene, wanted, known)
        if not len(joints):
            return no_nodes()
        votes, _ = kernels.vote_points(scene, joints, points, 1.0)
        good = votes > PROMISE * wanted.threshold
        joints, points, votes = joints[good], points[good], votes[good]
        first = distinct(points, joints, votes, SPACING)
        nodes = moved(scene, joints[first], points[first], wanted.view_threshold)
        return nodes.rows(distinct(nodes.points, nodes.joints, nodes.votes, SPACING))

    def seeds(self, scene: VoteScene, wanted: Demands, known: Explainer) -> tuple[Array, Array]:
        """Joints (S,) and points (S, 3) m where rays of `wanted.min_views` (two or more) views meet.

        Args:
            known: what explains peaks that then give no seeds.
        """
        peaks = known.unexplained(scene, find_peaks(scene, wanted.view_threshold))
        centres = np.stack([scene.cameras["ox"], scene.cameras["oy"], scene.cameras["oz"]], axis=-1)
        paired = _paired(centres.tobytes(), self.pair_views)
        meeting = ray_kernels.Meeting(self.gap, self.max_depth, max(wanted.min_views, 2), paired)
        found: tuple[Array, Array] = ray_kernels.pair_seeds(scene, peaks, meeting)
        return found


@lru_cache(maxsize=256)
def _paired(centres: bytes, count: int) -> Array:
    """Which `count` views are far from each other (V,), of the centres (V, 3) m of all."""
    return spread(np.frombuffer(centres).reshape(-1, 3), count)


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
