"""Identities of people who were lost for a short time: their curves get the same id."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from panoptic_ros.continuous.person import PersonCurve
from panoptic_ros.domain import SkeletonModel
from panoptic_ros.identity.likeness import BoneLengths, bone_evidence, paired, place_evidence
from panoptic_ros.identity.returns import RETURN_S, returns_at_once

Array = np.ndarray
DISTANCE, SPEED = 0.6, 1.2  # m and m/s: reach of a lost person, as in tracking
BONE_SIGMA = 0.01  # m, standard deviation of a learnt length


def with_identities(
    people: Sequence[PersonCurve], skeleton: SkeletonModel, pairs: Array
) -> list[PersonCurve]:
    """Return the curves in the order of their starts, numbered by person.

    Args:
        pairs: (P, 2) joints of the learnt lengths.
    """
    found = sorted(people, key=lambda person: float(person.seen[0]))
    bones = np.array(skeleton.bones, np.int64).reshape(-1, 2)
    groups = paired(bones, np.array(skeleton.mirror))
    known = {tuple(pair): k for k, pair in enumerate(np.sort(pairs, axis=1).tolist())}
    rows = [known[tuple(bone)] for bone in np.sort(bones, axis=1).tolist()]
    lengths = np.stack([_lengths(person, rows) for person in found]) if found else np.empty((0, len(rows)))
    variances = np.full(lengths.shape, BONE_SIGMA**2)
    ids, open_ends = 0, set[int]()
    for k, person in enumerate(found):
        begin = float(person.seen[0])
        lost = [i for i in sorted(open_ends) if 0.0 <= begin - found[i].seen[-1] <= RETURN_S]
        earlier = None
        if lost:
            missed = np.array([begin - found[i].seen[-1] for i in lost])
            places = np.stack([_place(found[i], float(found[i].seen[-1])) for i in lost])
            distances = np.linalg.norm(places - _place(person, begin), axis=1)[:, None]
            odds = bone_evidence(
                BoneLengths(lengths[lost], variances[lost]),
                BoneLengths(lengths[k : k + 1], variances[k : k + 1]),
                groups,
            )
            odds = odds + place_evidence(distances, missed)
            near = distances <= (DISTANCE + SPEED * missed)[:, None]
            for row, _ in returns_at_once(odds, missed, near):
                earlier = lost[row]
        if earlier is None:
            found[k] = replace(person, id=ids)
            ids += 1
        else:
            found[earlier] = replace(found[earlier], until=begin)
            found[k] = replace(person, id=found[earlier].id)
            open_ends.discard(earlier)
        open_ends.add(k)
    return found


def _lengths(person: PersonCurve, rows: list[int]) -> Array:
    """Return the learnt lengths (B,) m of the bones, NaN where a length is not constant."""
    return np.where(person.bones.weights[rows] > 0.0, person.bones.lengths[rows], np.nan)


def _place(person: PersonCurve, time: float) -> Array:
    """Return the place (2,) m of a person on the ground."""
    place: Array = np.nanmedian(person.at(np.array([time]))[0], axis=0)[:2]
    return place
