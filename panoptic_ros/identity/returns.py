"""Re-identification of people who were lost a moment ago and have reappeared nearby."""

from __future__ import annotations

import numpy as np

from panoptic_ros.identity.assignment import best_pairs
from panoptic_ros.identity.likeness import SURE

Array = np.ndarray
RETURN_S = 2.0  # s, absence up to which a similar person nearby is re-identified at once
PAUSE_S = (0.5, 15.0)  # s without views, limits of a pause: shorter = slow camera, longer = another scene
UNLIKE = -3.0  # log-odds below which no person is re-identified at once
CLEAR = float(np.log(SURE / (1.0 - SURE)))  # log-odds by which one person must exceed all others


def returns_at_once(odds: Array, missed: Array, near: Array) -> list[tuple[int, int]]:
    """Return pairs (lost, new) of people who were lost at most RETURN_S ago and have reappeared nearby.

    The pairs are the optimal assignment by the log-odds. A person who may as well be one lost longer ago is
    in no pair: that is decided after more observations.

    Args:
        odds: (T, P) log-odds that T lost people are P new people.
        missed: (T,) s since the people were lost, without pauses.
        near: (T, P) True where the distance is possible.
    """
    soon = missed <= RETURN_S
    rival = odds[~soon].max(axis=0, initial=-np.inf)
    can_be = near & soon[:, None] & (odds >= np.maximum(UNLIKE, rival + CLEAR))
    return best_pairs(np.where(can_be, -odds, np.inf), -UNLIKE)


def is_pause(steps: Array | float) -> Array:
    """Return whether times (s) without views are pauses.

    Cameras paused, or a node was restarted. A pause is no time in which people are missed.
    """
    return (PAUSE_S[0] < np.asarray(steps)) & (np.asarray(steps) <= PAUSE_S[1])
