"""Designated people: as words of a parameter ("3" or "3=0.4 -1.2 0.95"), and found among people in view."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import SubjectSet
from panoptic_ros.domain.designation import FIRST
from panoptic_ros.errors import ConfigError, DataError
from panoptic_ros.identity.assignment import best_pairs

Array = np.ndarray


def subject_word(number: int, place: Array | None) -> str:
    """The word that designates somebody by id and, if it is known, by place, m."""
    where = "" if place is None else "=" + " ".join(f"{value:.4g}" for value in place)
    return f"{number}{where}"


def subjects_of(words: Sequence[str], where: str = "subjects") -> SubjectSet:
    """Who is designated by these words; places count when the first people are seen.

    Args:
        where: the parameter, for the message.

    Raises:
        ConfigError: for a word of another form, or an id that stands twice.
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


REACH = 0.75  # m on the ground, from the place that is said: people are given by hand, or move already
WAIT = 5.0  # s, for which somebody may come late to it
BACK = 1.0  # s, how far the way of somebody is followed back to the time that is said


class Seen(NamedTuple):
    """People who are seen at an instant and have an identity.

    ids (T,); middles (T, 3) m of the bodies and their velocities drifts (T, 3) m/s.
    """

    ids: Array
    middles: Array
    drifts: Array


def found_subjects(
    subjects: SubjectSet, missing: Array, seen: Seen, stamp_ns: int, begun_ns: int
) -> dict[int, int]:
    """Which of the people are subjects that nobody is yet: {row of the people: row of the subjects}.

    Places choose first, nearest pairs together (Hungarian); who has none is whoever came first.

    Args:
        missing: rows (M,) of the subjects.
        begun_ns: when the first people were seen.
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
