"""How likely somebody who comes is somebody who left, by the body and the place.

Each cue is a log-odds: the logarithm of how much better what is seen fits one person than two strangers,
so cues add up. Bones: what was learnt of two visits of one person differs by the noise of these means; of
strangers also as people differ, who are of another stature first, and of other proportions besides. Place:
where somebody can have gone to since, against anywhere. With the log-odds of all who are away, and of
somebody new, Bayes' rule tells how sure it is who has come.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.identity.assignment import best_pairs

Array = np.ndarray

FRAME_SIGMA, FRAME_FRAMES = 0.02, 5.0  # m, of a length in a frame, before as many frames have told it
LASTING, CORRELATED = 0.1, 2.0  # share of that variance that no mean removes; frames that err alike
STATURE_SHARE, PEOPLE_SHARE = 0.06, 0.04  # of a length, by which people differ: all bones alike, each
MISTAKEN, MISTAKEN_SHARE = 0.02, 0.3  # share of the bones that were mistaken, and how long these may be
WORST = 3.0  # standard deviations of strangers, from which on differences tell no stature
SHORTEST = 0.01  # m, of a bone
ROOM = 20.0  # m^2, in which strangers appear
WALKING, STANDING = 1.0, 0.3  # m/s and m, standard deviation of where somebody is after an absence
RUNNING, AROUND = 3.0, 1.0  # m/s and m, which nobody exceeds


class Bones(NamedTuple):
    """Lengths (P, B) m of the bones of P people, NaN = not known, and their variances (P, B) m^2."""

    lengths: Array
    variances: Array


def learnt_bones(lengths: Array, counts: Array, squares: Array) -> Bones:
    """Bones by mean lengths (P, B) m of counts (P, B) frames.

    Args:
        squares: (P, B) m^2, the mean square of what one frame differs by.
    """
    total = FRAME_FRAMES * FRAME_SIGMA**2 + counts * squares
    frame = total / (FRAME_FRAMES + counts)
    return Bones(lengths, frame * (LASTING + np.minimum(CORRELATED / np.maximum(counts, 1.0), 1.0)))


def seen_bones(positions: Array, covariances: Array, bones: Array) -> Bones:
    """Bones (B, 2) of skeletons of one instant.

    Args:
        positions: (P, J, 3) m, NaN = no joint. covariances: (P, J, 3, 3) m^2.
    """
    a, b = bones.T
    gaps = positions[:, a] - positions[:, b]
    lengths = np.linalg.norm(gaps, axis=-1)
    along = gaps / np.maximum(lengths, SHORTEST)[..., None]
    stated = np.einsum("pbi,pbij,pbj->pb", along, covariances[:, a] + covariances[:, b], along)
    return Bones(lengths, stated + (1.0 + LASTING) * FRAME_SIGMA**2)


def paired(bones: Array, mirror: Array) -> Array:
    """Groups (B,) of bones (B, 2): left and right ones of a body are of one length and tell it once.

    Args:
        mirror: (J,) the joint on the other side of each.
    """
    ends = [sorted({(a, b), (int(mirror[a]), int(mirror[b]))}) for a, b in bones.tolist()]
    names = {name: number for number, name in enumerate(dict.fromkeys(map(tuple, ends)))}
    return np.array([names[tuple(end)] for end in ends], np.int64)


def bone_evidence(people: Bones, others: Bones, groups: Array) -> Array:
    """Log-odds (T, P) that T people and P others have the same bones; groups: see `paired`."""
    lengths, noises = _grouped(people, groups)
    other_lengths, other_noises = _grouped(others, groups)
    known = np.isfinite(lengths)[:, None] & np.isfinite(other_lengths)[None]
    a, b = np.nan_to_num(lengths)[:, None], np.nan_to_num(other_lengths)[None]
    mean = np.where(known, np.maximum(0.5 * (a + b), SHORTEST), 1.0)
    gaps = np.where(known, a - b, 0.0) / mean  # as shares of the length
    noise = np.where(known, (noises[:, None] + other_noises[None]) / mean**2, 1.0)
    strange, stature = noise + 2.0 * PEOPLE_SHARE**2, 2.0 * STATURE_SHARE**2
    weight = np.where(known & (np.abs(gaps) < WORST * np.sqrt(strange + stature)), 1.0 / strange, 0.0)
    spread = 1.0 / (weight.sum(axis=-1) + 1.0 / stature)
    taller = (weight * gaps).sum(axis=-1) * spread  # if they are strangers, most likely
    wrong = np.log(MISTAKEN) + log_normal(gaps, MISTAKEN_SHARE**2)
    one = np.logaddexp(np.log1p(-MISTAKEN) + log_normal(gaps, noise), wrong)
    two = np.logaddexp(np.log1p(-MISTAKEN) + log_normal(gaps - taller[..., None], strange), wrong)
    odds: Array = np.where(known, one - two, 0.0).sum(axis=-1)
    odds -= log_normal(taller, stature) + 0.5 * np.log(2.0 * np.pi * spread)  # the integral over the stature
    return odds


def log_normal(gaps: Array, variances: Array | float) -> Array:
    """Logarithms of the densities of normal variables."""
    densities: Array = -0.5 * (gaps**2 / variances + np.log(2.0 * np.pi * np.asarray(variances)))
    return densities


def _grouped(bones: Bones, groups: Array) -> tuple[Array, Array]:
    """Mean lengths (P, G) m of groups of bones, NaN = not known, and their variances (P, G) m^2."""
    known = np.isfinite(bones.lengths)
    member = np.eye(int(groups.max(initial=-1)) + 1)[groups]
    number = known @ member
    with np.errstate(invalid="ignore", divide="ignore"):
        lengths = (np.nan_to_num(bones.lengths) @ member) / number
    return lengths, (np.where(known, bones.variances, 0.0) @ member) / np.maximum(number, 1.0) ** 2


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
SURE = 0.99  # probability from which somebody is recognised, or is somebody new before the time is over


def recognised(odds: Array, seconds: Array, patience: float) -> Array:
    """Who each of P people is that have come: row of one of the T who are away, `NEW` or `WAIT`.

    Before anything is seen of somebody it is each of the T, or somebody new, with the same probability.

    Args:
        odds: (T, P) log-odds that they are one. seconds: (P,) for which those who came were seen.
        patience: s, after which it is decided with what is known: who is not recognised is new.
    """
    found = np.full(odds.shape[1], NEW)
    if not odds.size:
        return found
    total = np.logaddexp(0.0, np.logaddexp.reduce(odds, axis=0))
    sure = odds - total >= np.log(SURE)
    unsure = ~sure.any(axis=0) & (-total < np.log(SURE))
    found[unsure & (seconds < patience)] = WAIT
    for t, p in best_pairs(np.where(sure, -odds, np.inf), 0.0):  # nobody is sure at odds of 1 to 1
        found[p] = t
    return found
