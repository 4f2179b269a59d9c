"""Whether somebody who comes is one who was lost."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import PoseSet
from panoptic_ros.identity.appearance import Colours, colour_evidence
from panoptic_ros.identity.assignment import best_pairs
from panoptic_ros.identity.likeness import SURE, Bones, bone_evidence, place_evidence, seen_bones
from panoptic_ros.tracking.tracks import Tracks

Array = np.ndarray
RETURN_S = 2.0  # of absence, in which somebody who is near and alike has come back at once
UNLIKE = -3.0  # log-odds below which nobody is taken for somebody at once
CLEAR = float(np.log(SURE / (1.0 - SURE)))  # log-odds, by which one is meant and no other


class Arrivals(NamedTuple):
    """P people who have come: where, (P, 3) m, with which bones, in which clothes."""

    middles: Array
    bones: Bones
    clothes: Colours

    @classmethod
    def of_instant(cls, poses: PoseSet, rows: Array, looks: Array, bones: Array) -> Arrivals:
        """Some skeletons of an instant.

        Args:
            looks: (P, 2, 3) colours of clothes, NaN = not seen. bones: (B, 2).
        """
        positions = poses.positions[rows]
        known = seen_bones(positions, poses.covariances[rows], bones)
        return cls(np.nanmedian(positions, axis=1), known, Colours.of_looks(looks[rows]))

    @classmethod
    def of_tracks(cls, tracks: Tracks) -> Arrivals:
        """People who have been followed since they came."""
        return cls(tracks.bodies.middles, tracks.bones, tracks.clothes)


def return_odds(lost: Tracks, came: Arrivals, groups: Array) -> Array:
    """Log-odds (T, P) that T people who were lost are those who have come, by bones, place and clothes.

    Args:
        groups: of bones, see `identity.likeness.paired`.
    """
    odds: Array = bone_evidence(lost.bones, came.bones, groups)
    odds += place_evidence(ground_distances(lost, came), lost.unseen)
    odds += colour_evidence(lost.clothes, came.clothes)
    return odds


def returned_at_once(lost: Tracks, came: Arrivals, groups: Array, reach: Array) -> list[tuple[int, int]]:
    """Pairs (lost, come) of people who were lost a moment ago and have come again, not far from there.

    Of all ways to pair them the most likely one. Somebody who may as well be one who was lost long ago is in
    no pair: that is decided when more was seen.

    Args:
        reach: (T,) m, how far each may have come.
    """
    odds = return_odds(lost, came, groups)
    soon = lost.missed <= RETURN_S
    rival = odds[~soon].max(axis=0, initial=-np.inf)
    near = ground_distances(lost, came) <= reach[:, None]
    can_be = near & soon[:, None] & (odds >= np.maximum(UNLIKE, rival + CLEAR))
    return best_pairs(np.where(can_be, -odds, np.inf), -UNLIKE)


def ground_distances(lost: Tracks, came: Arrivals) -> Array:
    """Distances (T, P) m on the ground of those who have come from where others must be."""
    distances: Array = np.linalg.norm((lost.bodies.middles[:, None] - came.middles[None])[..., :2], axis=-1)
    return distances
