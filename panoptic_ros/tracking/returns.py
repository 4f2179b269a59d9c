"""Whether somebody who comes is one who was lost."""
from __future__ import annotations

import numpy as np

from panoptic_ros.identity.appearance import Colours, colour_evidence
from panoptic_ros.identity.likeness import Bones, bone_evidence, place_evidence
from panoptic_ros.tracking.tracks import Tracks, bone_lengths

Array = np.ndarray


def return_odds(away: Tracks, middles: Array, bones: Bones, clothes: Colours, groups: Array) -> Array:
    """Log-odds (T, P) that T people who were lost are those who have come, by bones, place and clothes.

    Args:
        middles: (P, 3) m of those who have come. groups: of bones, see `identity.likeness.paired`.
    """
    gaps = np.linalg.norm((away.middles[:, None] - middles[None])[..., :2], axis=-1)
    odds: Array = bone_evidence(away.bones, bones, groups) + place_evidence(gaps, away.unseen)
    odds += colour_evidence(away.clothes, clothes)
    return odds


def return_costs(tracks: Tracks, positions: Array, bones: Array) -> tuple[Array, Array]:
    """Distances (T, P) m on the ground of skeletons (P, J, 3) from the predicted middles of tracks.

    Also differences (T, P): the median relative difference of bone lengths, 0 where fewer than three are
    known.
    """
    shape = (len(tracks.ids), len(positions))
    distances, differences = np.full(shape, np.inf), np.zeros(shape)
    lengths = bone_lengths(positions, bones)
    for k, joints in enumerate(positions):
        measured = np.isfinite(joints[:, 0])
        if not measured.any():
            continue
        middle = np.median(joints[measured], axis=0)
        for t in range(shape[0]):
            distances[t, k] = np.linalg.norm((tracks.middles[t] - middle)[:2])
            both = np.isfinite(lengths[k]) & np.isfinite(tracks.lengths[t])
            if both.sum() >= 3:
                ratio = lengths[k][both] / np.maximum(tracks.lengths[t][both], 1e-3)
                differences[t, k] = np.median(np.abs(ratio - 1.0))
    return distances, differences
