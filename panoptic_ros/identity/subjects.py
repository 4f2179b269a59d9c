"""Ids of people, and designated people (subjects), who have ids of their own.

A word is an id, such as "3", or an id with a position in m, such as "3=0.4 -1.2 0.95".
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import SubjectSet
from panoptic_ros.domain.designation import FIRST
from panoptic_ros.errors import ConfigError, DataError
from panoptic_ros.identity.assignment import best_pairs

Array = np.ndarray


def subject_word(number: int, place: Array | None) -> str:
    """Return the word that designates a subject by id and, if it is known, by position.

    Args:
        place: (3,) m, None = unknown.
    """
    where = "" if place is None else "=" + " ".join(f"{value:.4g}" for value in place)
    return f"{number}{where}"


def subjects_of(words: Sequence[str], where: str = "subjects") -> SubjectSet:
    """Return the subjects that words designate. Positions apply when the first people are seen.

    Args:
        where: name of the parameter, for the error message.

    Raises:
        ConfigError: for a word of another form, or an id that occurs twice.
    """
    ids, places = [], []
    for word in words:
        number, equals, place = word.partition("=")
        try:
            ids.append(int(number))
            places.append([float(value) for value in place.split()] if equals else [np.nan] * 3)
        except ValueError:
            places.append([])
        if len(places[-1]) != 3 or np.isinf(places[-1]).any():
            raise ConfigError(
                f"{where}: {word!r} is not of the form ID or ID=X Y Z in metres, e.g. 3=0.4 -1.2 0.95"
            )
    try:
        return SubjectSet(0, np.array(ids, np.int64), np.array(places, float).reshape(-1, 3))
    except DataError as error:
        raise ConfigError(f"{where}: {error}") from None


# m on the ground, maximum distance from the stated position, which is entered by hand; the person may move
REACH = 0.75
WAIT = 5.0  # s, longest delay after the stated time with which a person may reach the position
BACK = 1.0  # s, longest time over which a person's motion is extrapolated back to the stated time


class VisibleTracks(NamedTuple):
    """People with an identity who are seen at an instant.

    Args:
        ids: (T,) identities.
        middles: (T, 3) m, world, centres of the bodies.
        drifts: (T, 3) m/s, velocities of the centres.
    """

    ids: Array
    middles: Array
    drifts: Array


def found_subjects(
    subjects: SubjectSet, missing: Array, seen: VisibleTracks, stamp_ns: int, begun_ns: int
) -> dict[int, int]:
    """Return the people who become subjects: {row of the people: row of the subjects}.

    Subjects with a position choose first, by optimal assignment of the distances (Hungarian). Subjects
    without a position and without a stated track are the people who came first.

    Args:
        missing: (M,) rows of subjects that are assigned to no person yet.
        stamp_ns: time of the instant.
        begun_ns: time at which the first people were seen.
    """
    found: dict[int, int] = {}
    times = np.where(subjects.times[missing] == FIRST, begun_ns, subjects.times[missing])
    late = 1e-9 * (stamp_ns - times)
    placed = np.isfinite(subjects.places[missing, 0])
    due = missing[placed & (late >= 0.0) & (late <= WAIT)]
    if len(due):
        back = np.clip(late[np.isin(missing, due)], 0.0, BACK)[:, None, None]
        back[subjects.times[due] == FIRST] = 0.0
        gaps = seen.middles - back * seen.drifts - subjects.places[due][:, None]
        cost = np.linalg.norm(gaps[..., :2], axis=-1)
        found = {row: int(due[s]) for s, row in best_pairs(cost, REACH)}
    anywhere = missing[~placed & (subjects.tracks[missing] < 0)]
    order = [row for row in np.argsort(seen.ids).tolist() if row not in found]
    found.update(zip(order, anywhere.tolist()))
    return found


@dataclass(eq=False)
class PublicIds:
    """Ids of people: numbers that no person has had, and those of the subjects.

    Args:
        subjects: Designated people; all others are bystanders.
        next: Lower bound of the next new id.
        begun_ns: Time at which people were seen first since the designation; None = no person yet.
    """

    subjects: SubjectSet
    next: int = 0
    begun_ns: int | None = None

    def designate(self, subjects: SubjectSet) -> None:
        """Replace the designation of subjects."""
        self.subjects, self.begun_ns = subjects, None

    def new(self) -> int:
        """Return an id that no person has had, and that is not a subject's."""
        while self.next in self.subjects.ids:
            self.next += 1
        self.next += 1
        return self.next - 1

    def are_reported(self, ids: Array, bystanders: bool) -> Array:
        """Return which of the people (P,) are reported: all, or only the subjects."""
        if bystanders or not len(self.subjects.ids):
            return np.ones(len(ids), bool)
        return np.isin(ids, self.subjects.ids)

    def find_subjects(
        self,
        ids: Array,
        here: Array,
        bodies: Callable[[Array], tuple[Array, Array]],
        stamp_ns: int,
    ) -> list[tuple[int, int]]:
        """Give the subjects' ids to the people who are designated.

        Args:
            ids: (T,) identities, written; -1 = not numbered yet.
            here: (T,) True for people in view.
            bodies: returns centres (K, 3) m and velocities (K, 3) m/s of the people in rows (K,).
            stamp_ns: time of the instant.

        Returns:
            the new and the earlier id of each subject that was found.
        """
        subjects = self.subjects
        if not len(subjects.ids):
            return []
        found: dict[int, int] = {}
        for s in np.flatnonzero(np.isin(subjects.tracks, ids[ids >= 0])).tolist():
            found |= {int(row): s for row in np.flatnonzero(ids == subjects.tracks[s])}
        if found:  # each stated track is used once
            left = subjects.tracks.copy()
            left[list(found.values())] = -1
            self.subjects = replace(subjects, tracks=left)
        missing = np.flatnonzero(~np.isin(subjects.ids, ids))
        rows = np.flatnonzero((ids >= 0) & here & ~np.isin(ids, subjects.ids))
        if len(rows) and self.begun_ns is None:
            self.begun_ns = stamp_ns
        if len(missing) and len(rows):
            seen = VisibleTracks(ids[rows], *bodies(rows))
            chosen = found_subjects(subjects, missing, seen, stamp_ns, self.begun_ns or stamp_ns)
            found = {int(rows[row]): s for row, s in chosen.items()} | found
        told = []
        for row, s in found.items():
            number, before = int(subjects.ids[s]), int(ids[row])
            for other in np.flatnonzero(ids == number):
                ids[other] = self.new()
            ids[row] = number
            told.append((number, before))
        return told
