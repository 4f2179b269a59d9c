"""Re-identification score: log-odds that a new track is a lost track, from bone lengths and position.

Each cue is a log-odds: the log-likelihood ratio of the observation for one person against two strangers. So
cues add up. Learnt bone lengths of two visits of one person differ only by the noise of the means. Those of
strangers also differ by stature, which scales all bones, and by the proportions of single bones. The position
cue compares two densities: that of a person who has walked from the last position, and a uniform one over the
room. Bayes' rule over all lost people and a new person gives the probability of each identity.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.identity.assignment import best_pairs

Array = np.ndarray

# m, prior standard deviation of a bone length in one frame; weight of this prior in frames
FRAME_SIGMA, FRAME_FRAMES = 0.02, 5.0
# share of that variance that no averaging removes; number of successive frames with the same error
LASTING, CORRELATED = 0.1, 2.0
# standard deviations over people, as shares of a length: of stature (all bones alike), of single bones
STATURE_SHARE, PEOPLE_SHARE = 0.06, 0.04
# share of bones with a wrong length; standard deviation of their differences, as a share of the length
MISTAKEN, MISTAKEN_SHARE = 0.02, 0.3
WORST = 3.0  # standard deviations of strangers; larger differences are ignored in the estimate of stature
SHORTEST = 0.01  # m, least length of a bone in divisions
ROOM = 20.0  # m^2, floor area in which strangers appear
# m/s and m: after an absence t, the standard deviation of a position is sqrt(STANDING^2 + (WALKING t)^2)
WALKING, STANDING = 1.0, 0.3
RUNNING, AROUND = 3.0, 1.0  # m/s and m: no person moves farther than AROUND + RUNNING t


class BoneLengths(NamedTuple):
    """Bone lengths of P people.

    Args:
        lengths: (P, B) m, NaN = unknown.
        variances: (P, B) m^2 of the lengths.
    """

    lengths: Array
    variances: Array


def learnt_bones(lengths: Array, counts: Array, squares: Array) -> BoneLengths:
    """Return bones from mean lengths (P, B) m over `counts` (P, B) frames.

    Args:
        squares: (P, B) m^2, mean squared deviation of single frames from the mean.
    """
    total = FRAME_FRAMES * FRAME_SIGMA**2 + counts * squares
    frame = total / (FRAME_FRAMES + counts)
    return BoneLengths(lengths, frame * (LASTING + np.minimum(CORRELATED / np.maximum(counts, 1.0), 1.0)))


def seen_bones(positions: Array, covariances: Array, bones: Array) -> BoneLengths:
    """Return the bones (B, 2) of skeletons of one instant.

    Args:
        positions: (P, J, 3) m, NaN = no joint.
        covariances: (P, J, 3, 3) m^2.
        bones: (B, 2) joints at the ends.
    """
    a, b = bones.T
    gaps = positions[:, a] - positions[:, b]
    lengths = np.linalg.norm(gaps, axis=-1)
    along = gaps / np.maximum(lengths, SHORTEST)[..., None]
    stated = np.einsum("pbi,pbij,pbj->pb", along, covariances[:, a] + covariances[:, b], along)
    return BoneLengths(lengths, stated + (1.0 + LASTING) * FRAME_SIGMA**2)


def paired(bones: Array, mirror: Array) -> Array:
    """Return the group (B,) of each bone (B, 2). A left bone and its right counterpart form one group.

    Both have the same length in a body, so they are treated as one measurement.

    Args:
        mirror: (J,) joint on the other side of each joint.
    """
    ends = [sorted({(a, b), (int(mirror[a]), int(mirror[b]))}) for a, b in bones.tolist()]
    names = {name: number for number, name in enumerate(dict.fromkeys(map(tuple, ends)))}
    return np.array([names[tuple(end)] for end in ends], np.int64)


def bone_evidence(people: BoneLengths, others: BoneLengths, groups: Array) -> Array:
    """Return the log-odds (T, P) that T people and P others are the same, by bone lengths.

    Args:
        groups: (B,) see `paired`.
    """
    lengths, noises = _grouped(people, groups)
    other_lengths, other_noises = _grouped(others, groups)
    known = np.isfinite(lengths)[:, None] & np.isfinite(other_lengths)[None]
    a, b = np.nan_to_num(lengths)[:, None], np.nan_to_num(other_lengths)[None]
    mean = np.where(known, np.maximum(0.5 * (a + b), SHORTEST), 1.0)
    gaps = np.where(known, a - b, 0.0) / mean  # relative differences
    noise = np.where(known, (noises[:, None] + other_noises[None]) / mean**2, 1.0)
    strange, stature = noise + 2.0 * PEOPLE_SHARE**2, 2.0 * STATURE_SHARE**2
    weight = np.where(known & (np.abs(gaps) < WORST * np.sqrt(strange + stature)), 1.0 / strange, 0.0)
    spread = 1.0 / (weight.sum(axis=-1) + 1.0 / stature)
    taller = (weight * gaps).sum(axis=-1) * spread  # most likely difference of stature, if they are strangers
    wrong = np.log(MISTAKEN) + log_normal(gaps, MISTAKEN_SHARE**2)
    one = np.logaddexp(np.log1p(-MISTAKEN) + log_normal(gaps, noise), wrong)
    two = np.logaddexp(np.log1p(-MISTAKEN) + log_normal(gaps - taller[..., None], strange), wrong)
    odds: Array = np.where(known, one - two, 0.0).sum(axis=-1)
    odds -= log_normal(taller, stature) + 0.5 * np.log(2.0 * np.pi * spread)  # marginalise stature
    return odds


def log_normal(gaps: Array, variances: Array | float) -> Array:
    """Return the log-densities of normal variables with mean 0."""
    densities: Array = -0.5 * (gaps**2 / variances + np.log(2.0 * np.pi * np.asarray(variances)))
    return densities


def _grouped(bones: BoneLengths, groups: Array) -> tuple[Array, Array]:
    """Return the mean lengths (P, G) m of groups of bones, NaN = unknown, and their variances (P, G) m^2."""
    known = np.isfinite(bones.lengths)
    member = np.eye(int(groups.max(initial=-1)) + 1)[groups]
    number = known @ member
    with np.errstate(invalid="ignore", divide="ignore"):
        lengths = (np.nan_to_num(bones.lengths) @ member) / number
    return lengths, (np.where(known, bones.variances, 0.0) @ member) / np.maximum(number, 1.0) ** 2


def place_evidence(distances: Array, unseen: Array) -> Array:
    """Return the log-odds (T, P) that T lost people have moved to the positions of P others.

    They fall towards 0 with the time of absence, because the position then contains less and less
    information. They are -inf where the person cannot have got so far.

    Args:
        distances: (T, P) m on the ground, from the positions at which people were lost.
        unseen: (T,) s, time since they were lost.
    """
    spread = (STANDING**2 + (WALKING * unseen) ** 2)[:, None]
    near = ROOM / (2.0 * np.pi * spread) * np.exp(-0.5 * distances**2 / spread)
    reach = (AROUND + RUNNING * unseen)[:, None]
    odds: Array = np.where(distances <= reach, np.log(np.maximum(near, 1.0)), -np.inf)
    return odds


NEW, WAIT = -1, -2  # results for tracks that are not recognised: a new person, undecided
SURE = 0.99  # probability from which a track is recognised, or is a new person before the time is over


def recognised(odds: Array, seconds: Array, patience: float) -> Array:
    """Return the identity (P,) of new tracks: the row of one of T lost people, `NEW` or `WAIT`.

    Before any observation, all T lost people and a new person have the same probability.

    Args:
        odds: (T, P) log-odds that they are one person.
        seconds: (P,) s, duration of the new tracks.
        patience: s, duration after which the decision is final: a person who is not recognised is new.
    """
    found = np.full(odds.shape[1], NEW)
    if not odds.size:
        return found
    total = np.logaddexp(0.0, np.logaddexp.reduce(odds, axis=0))
    sure = odds - total >= np.log(SURE)
    unsure = ~sure.any(axis=0) & (-total < np.log(SURE))
    found[unsure & (seconds < patience)] = WAIT
    for t, p in best_pairs(np.where(sure, -odds, np.inf), 0.0):  # gate at even odds, below all certain pairs
        found[p] = t
    return found
