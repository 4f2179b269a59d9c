"""How likely somebody who comes is somebody who left, by the body and the place.

Each cue is a log-odds: the logarithm of how much better what is seen fits one person than two strangers,
so cues add up. Bones: a difference of lengths is noise and clothing if it is one person, and as large as
people differ if not; both are normal. Place: where somebody can have gone to since, against anywhere.
"""
from __future__ import annotations

import numpy as np

from panoptic_ros.identity.assignment import best_pairs

Array = np.ndarray

BONE_SIGMA = 0.012  # m, by which the learnt lengths of one person's bone differ from one visit to the other
FRAME_SIGMA = 0.02  # m, by which a length differs from one frame to the next
PEOPLE_SHARE = 0.09  # of its length, by which a bone differs from person to person
ALIKE = 0.4  # weight of each bone: those of one body tell much the same
WORST = 3.0  # standard deviations, at which a bone's difference is cut: it was mistaken
ROOM = 20.0  # m^2, in which strangers appear
WALKING, STANDING = 1.0, 0.3  # m/s and m, standard deviation of where somebody is after an absence
RUNNING, AROUND = 3.0, 1.0  # m/s and m, which nobody exceeds


def bone_evidence(lengths: Array, counts: Array, others: Array, other_counts: Array) -> Array:
    """Log-odds (T, P) that people (T, B) and others (P, B) have the same bones.

    Args:
        lengths, others: m, NaN = not known. counts, other_counts: of how many frames they are the mean.
    """
    known = np.isfinite(lengths)[:, None] & np.isfinite(others)[None]
    a, b = np.nan_to_num(lengths)[:, None], np.nan_to_num(others)[None]
    frames = 1.0 / np.maximum(counts, 1.0)[:, None] + 1.0 / np.maximum(other_counts, 1.0)[None]
    noise = BONE_SIGMA**2 + FRAME_SIGMA**2 * frames
    spread = noise + 2.0 * (0.5 * PEOPLE_SHARE * (a + b)) ** 2
    square = np.minimum((a - b) ** 2, WORST**2 * noise)
    odds = 0.5 * (np.log(spread / noise) + square / spread - square / noise)
    total: Array = ALIKE * np.where(known, odds, 0.0).sum(axis=-1)
    return total


def place_evidence(distances: Array, unseen: Array) -> Array:
    """Log-odds (T, P) of distances (T, P) m on the ground from where people were lost (T,) s ago.

    -inf if nobody gets so far.
    With time the place tells less and less, until it tells nothing.
    """
    spread = (STANDING**2 + (WALKING * unseen) ** 2)[:, None]
    near = ROOM / (2.0 * np.pi * spread) * np.exp(-0.5 * distances**2 / spread)
    reach = (AROUND + RUNNING * unseen)[:, None]
    odds: Array = np.where(distances <= reach, np.log(np.maximum(near, 1.0)), -np.inf)
    return odds


NEW, WAIT = -1, -2  # in place of a person who is recognised
SURE, MARGIN = 4.0, 1.0  # log-odds from which somebody is recognised; lead over the next one
UNLIKE = -2.0  # log-odds below which it is somebody else
LIKELY = 2.0  # the same when there is no more time to look


def recognised(odds: Array, seconds: Array, patience: float) -> Array:
    """Who each of P people is that have come: row of one of the T who are away, `NEW` or `WAIT`.

    Args:
        odds: (T, P) log-odds that they are one. seconds: (P,) for which those who came were seen.
        patience: s, after which it is decided with what is known.
    """
    found = np.full(odds.shape[1], NEW)
    if not odds.size:
        return found
    order = np.sort(odds, axis=0)
    best, next_best = order[-1], order[-2] if len(order) > 1 else np.full(odds.shape[1], -np.inf)
    clear, late = best >= np.maximum(next_best + MARGIN, UNLIKE), seconds >= patience
    good = clear & (best >= np.where(late, LIKELY, SURE))
    found[~good & ~late & (best > UNLIKE)] = WAIT
    for t, p in best_pairs(np.where(good[None] & (odds == best), -odds, np.inf)):
        found[p] = t
    return found
