"""Identities of people who were lost for a short time: they get the same id when they reappear."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from panoptic_ros.continuous.appearance import Appearance
from panoptic_ros.continuous.bones import LearntLengths
from panoptic_ros.continuous.person import PersonCurve
from panoptic_ros.domain import SkeletonModel
from panoptic_ros.identity.likeness import BoneLengths, bone_evidence, paired, place_evidence
from panoptic_ros.identity.numbering import numbering_order
from panoptic_ros.identity.returns import RETURN_S, returns_at_once

Array = np.ndarray
DISTANCE, SPEED = 0.6, 1.2  # m and m/s: reach of a lost person, as in tracking


class SeenPerson(NamedTuple):
    """Person at the end or the beginning of a track.

    Args:
        time: (s) of the last or the first view.
        place: (2,) m on the ground at that time.
        lengths: (B,) m of the bones, NaN = unknown.
        variances: (B,) m^2.
    """

    time: float
    place: Array
    lengths: Array
    variances: Array


class ReturnSearch:
    """Search for the lost person who a new one is.

    Args:
        pairs: (P, 2) joints of the learnt lengths.
    """

    def __init__(self, skeleton: SkeletonModel, pairs: Array):
        bones = np.array(skeleton.bones, np.int64).reshape(-1, 2)
        known = {tuple(pair): k for k, pair in enumerate(np.sort(pairs, axis=1).tolist())}
        self._groups = paired(bones, np.array(skeleton.mirror))
        self._rows = [known[tuple(bone)] for bone in np.sort(bones, axis=1).tolist()]

    def bone_lengths(self, learnt: LearntLengths | None) -> BoneLengths:
        """Return the bones (B,) of a person; lengths are NaN where unknown or not constant."""
        if learnt is None:
            return BoneLengths(np.full(len(self._rows), np.nan), np.ones(len(self._rows)))
        rows = self._rows
        lengths = np.where(learnt.weights[rows] > 0.0, learnt.lengths[rows], np.nan)
        return BoneLengths(lengths, learnt.variances[rows])

    def returned(self, lost: Sequence[SeenPerson], new: SeenPerson) -> int | None:
        """Return the index of the lost person who a new one is; None if it is none of them."""
        rows = [k for k, person in enumerate(lost) if 0.0 <= new.time - person.time <= RETURN_S]
        if not rows:
            return None
        missed = np.array([new.time - lost[k].time for k in rows])
        distances = np.array([np.linalg.norm(lost[k].place - new.place) for k in rows])[:, None]
        bones = bone_evidence(_bones([lost[k] for k in rows]), _bones([new]), self._groups)
        odds = bones + place_evidence(distances, missed)
        near = distances <= (DISTANCE + SPEED * missed)[:, None]
        found = returns_at_once(odds, missed, near)
        return rows[found[0][0]] if found else None


def _bones(people: Sequence[SeenPerson]) -> BoneLengths:
    return BoneLengths(np.stack([p.lengths for p in people]), np.stack([p.variances for p in people]))


def with_identities(
    people: Sequence[tuple[PersonCurve, Appearance]], skeleton: SkeletonModel, pairs: Array, interval: float
) -> list[PersonCurve]:
    """Return the curves in the order of their starts, numbered by person.

    Args:
        people: Curves and the appearances.
        pairs: (P, 2) joints of the learnt lengths.
        interval: (s) see `identity.numbering.numbering_order`.
    """
    search = ReturnSearch(skeleton, pairs)
    ordered = sorted(people, key=lambda one: float(one[0].seen[0]))
    found = [person for person, _ in ordered]
    firsts = list(range(len(found)))  # index of the first curve of the same person
    lost: dict[int, SeenPerson] = {}  # ends of the curves that no curve continues, by index
    for k, person in enumerate(found):
        first, last = (
            SeenPerson(time, _place(person, time), *search.bone_lengths(person.bones))
            for time in (float(person.seen[0]), float(person.seen[-1]))
        )
        row = search.returned(list(lost.values()), first)
        if row is not None:
            earlier = list(lost)[row]
            found[earlier] = replace(found[earlier], until=first.time)
            firsts[k] = firsts[earlier]
            del lost[earlier]
        lost[k] = last
    new = np.unique(firsts)
    came = [ordered[k][1] for k in new.tolist()]
    places, times = np.array([one.place for one in came]), np.array([one.time for one in came])
    order = numbering_order(places.reshape(-1, 2), times, interval)
    ids = {int(new[row]): number for number, row in enumerate(order.tolist())}
    return [replace(person, id=ids[first]) for person, first in zip(found, firsts)]


def _place(person: PersonCurve, time: float) -> Array:
    """Return the place (2,) m of a person on the ground."""
    place: Array = np.nanmedian(person.at(np.array([time]))[0], axis=0)[:2]
    return place
