"""Identities of people who were lost for a short time: they get the same id when they reappear."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from panoptic_ros.continuous.bones import LearntLengths
from panoptic_ros.continuous.person import PersonCurve
from panoptic_ros.domain import SkeletonModel
from panoptic_ros.identity.likeness import (
    NEW,
    BoneLengths,
    bone_evidence,
    paired,
    place_evidence,
    recognised,
    seen_bones,
)
from panoptic_ros.identity.numbering import numbering_order, numbering_places
from panoptic_ros.identity.returns import RETURN_S, is_pause, returns_at_once

Array = np.ndarray
# m, error of learnt lengths that no averaging removes. With 3.3 mm or less, people of Shelf lose their ids at
# cuts; with 4 mm or more, a newcomer of the same size gets the id of a lost person (case `visitors`, seed 2)
LASTING_SIGMA = 3.6e-3
TAIL_S = 0.5  # s, longest time from the start of a new track of a person to the end of the earlier one
# periods of a camera within which people appear together: the next set of synchronous cameras is left out
TOGETHER = 0.9
DISTANCE, SPEED = 0.6, 1.2  # m and m/s: reach of a lost person, as in tracking


class SeenPerson(NamedTuple):
    """Person at the end of a track, or as it appeared.

    Args:
        time: (s) of the last view or the appearance.
        watched: (s) the same time on a clock that stands still in pauses, see `watched_times`.
        place: (2,) m on the ground at that time.
        lengths: (B,) m of the bones, NaN = unknown.
        variances: (B,) m^2.
    """

    time: float
    watched: float
    place: Array
    lengths: Array
    variances: Array


class ReturnOdds(NamedTuple):
    """Comparison of T lost people with P new ones, who appear together.

    Args:
        odds: (T, P) log-odds that they are one person.
        missed: (T,) s of absence, without pauses.
        near: (T, P) True where the distance is possible within a moment.
    """

    odds: Array
    missed: Array
    near: Array


class ReturnSearch:
    """Search for the lost person who a new one is.

    Args:
        pairs: (P, 2) joints of the learnt lengths.
    """

    def __init__(self, skeleton: SkeletonModel, pairs: Array):
        self._bones = bones = np.array(skeleton.bones, np.int64).reshape(-1, 2)
        known = {tuple(pair): k for k, pair in enumerate(np.sort(pairs, axis=1).tolist())}
        self._groups = paired(bones, np.array(skeleton.mirror))
        self._rows = [known[tuple(bone)] for bone in np.sort(bones, axis=1).tolist()]

    def bone_lengths(self, learnt: LearntLengths | None) -> BoneLengths:
        """Return the bones (B,) of a person; lengths are NaN where unknown or not constant."""
        if learnt is None:
            return BoneLengths(np.full(len(self._rows), np.nan), np.ones(len(self._rows)))
        rows = self._rows
        lengths = np.where(learnt.weights[rows] > 0.0, learnt.lengths[rows], np.nan)
        return BoneLengths(lengths, learnt.variances[rows] + LASTING_SIGMA**2)

    def instant_lengths(self, positions: Array, covariances: Array) -> BoneLengths:
        """Return the bones (B,) of joints (J, 3) m with covariances (J, 3, 3) m^2 at an instant."""
        one = seen_bones(positions[None], covariances[None], self._bones)
        return BoneLengths(one.lengths[0], one.variances[0])

    def compare(self, lost: Sequence[SeenPerson], new: Sequence[SeenPerson], possible: Array) -> ReturnOdds:
        """Return the comparison of lost people with new ones, who appear together.

        Args:
            possible: (T, P) False where a lost person and a new one are two people in any case.
        """
        begins = np.array([one.time for one in new])
        time, watched = min((one.time, one.watched) for one in new)
        missed = np.maximum([watched - one.watched for one in lost], 0.0)
        unseen = np.maximum([time - one.time for one in lost], 0.0)
        gaps = np.array([one.place for one in lost])[:, None] - np.array([one.place for one in new])
        distances = np.linalg.norm(gaps, axis=-1)
        odds = bone_evidence(_bones(lost), _bones(new), self._groups) + place_evidence(distances, unseen)
        possible = possible & (np.array([one.time for one in lost])[:, None] < begins + TAIL_S)
        near = possible & (distances <= (DISTANCE + SPEED * unseen)[:, None])
        return ReturnOdds(np.where(possible, odds, -np.inf), missed, near)

    def returned(
        self,
        lost: Sequence[SeenPerson],
        new: Sequence[SeenPerson],
        possible: Array,
        seconds: Array | None = None,
        patience: float = 0.0,
    ) -> Array:
        """Return the index (P,) of the lost person who each new one is, `NEW` or `WAIT`.

        People who were lost at most `RETURN_S` ago are recognised at once. If some were lost longer ago, the
        evidence decides with the time of observation, see `identity.likeness.recognised`.

        Args:
            lost, new, possible: see `compare`.
            seconds: (P,) s of observation. None: 0.
            patience: see `recognised`.
        """
        found = np.full(len(new), NEW)
        rows = np.flatnonzero(possible.any(axis=1))
        if not len(rows):
            return found
        odds, missed, near = self.compare([lost[k] for k in rows.tolist()], new, possible[rows])
        pairs = returns_at_once(odds, missed, near)
        for t, p in pairs:
            found[p] = rows[t]
        if (missed > RETURN_S).any():
            left = np.setdiff1d(np.arange(len(rows)), [t for t, _ in pairs])
            open_ones = np.flatnonzero(found == NEW)
            times = np.zeros(len(new)) if seconds is None else seconds
            later = recognised(odds[np.ix_(left, open_ones)], times[open_ones], patience)
            found[open_ones] = [rows[left[t]] if t >= 0 else t for t in later.tolist()]
        return found


def _bones(people: Sequence[SeenPerson]) -> BoneLengths:
    return BoneLengths(np.stack([p.lengths for p in people]), np.stack([p.variances for p in people]))


def watched_times(times: Array | float, frames: Array) -> Array:
    """Return times (T,) s on a clock that stands still in pauses of all cameras.

    Args:
        frames: (F,) s, sorted times of the views of all cameras.
    """
    steps = np.diff(frames)
    clock = np.concatenate([[0.0], np.cumsum(np.where(is_pause(steps), 0.0, steps))])
    watched: Array = np.interp(times, frames, clock)
    return watched


def with_identities(
    people: Sequence[tuple[PersonCurve, float]],
    skeleton: SkeletonModel,
    pairs: Array,
    frames: Array,
    interval: float,
) -> list[PersonCurve]:
    """Return the curves in the order of their appearance, numbered by person.

    Args:
        people: Curves, and the times (s) at which the people appear.
        pairs: (P, 2) joints of the learnt lengths.
        frames: (F,) s, sorted times of the views of all cameras.
        interval: (s) time within which people have appeared together.
    """
    search = ReturnSearch(skeleton, pairs)

    def seen_at(person: PersonCurve, time: float) -> SeenPerson:
        place, watched = numbering_places(person.at(np.array([time])))[0], watched_times(time, frames)
        return SeenPerson(time, float(watched), place, *search.bone_lengths(person.bones))

    ordered = sorted(people, key=lambda one: one[1])
    firsts = [seen_at(person, time) for person, time in ordered]
    found = [replace(person, id=-1) for person, _ in ordered]
    lost: dict[int, SeenPerson] = {}  # ends of the curves that no curve continues, by index
    begin = count = 0
    while begin < len(found):
        first = firsts[begin]
        group = [k for k in range(begin, len(found)) if firsts[k].time <= first.time + interval]
        lost = {k: one for k, one in lost.items() if first.watched - one.watched <= RETURN_S}
        numbers, new = list(lost), [firsts[k] for k in group]
        shared = [[_share_view(found[t], found[k]) for k in group] for t in numbers]
        possible = ~np.array(shared, bool).reshape(len(numbers), len(new))
        for k, row in zip(group, search.returned(list(lost.values()), new, possible).tolist()):
            if row != NEW:
                earlier = numbers[row]
                found[k] = replace(found[k], id=found[earlier].id)
                found[earlier] = replace(found[earlier], until=float(found[k].seen[0]))
                del lost[earlier]
        group = [k for k in group if found[k].id < 0]
        for row in numbering_order(np.array([firsts[k].place for k in group]).reshape(-1, 2)):
            found[group[row]] = replace(found[group[row]], id=count)
            count += 1
        for k in range(begin, begin + len(new)):
            lost[k] = seen_at(found[k], float(found[k].seen[-1]))
        begin += len(new)
    return found


def _share_view(earlier: PersonCurve, later: PersonCurve) -> bool:
    """Return whether an image shows both."""
    if earlier.seen[-1] < later.seen[0]:
        return False
    images = [set(zip(one.rays.cameras.tolist(), one.rays.stamps.tolist())) for one in (earlier, later)]
    return not images[0].isdisjoint(images[1])
