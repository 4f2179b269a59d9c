"""Choice of the subject among the people of a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from panoptic_ros.continuous.person import PersonCurve
from panoptic_ros.domain.subjects import Subject
from panoptic_ros.errors import UsageError


def designated(subject: Subject, people: Sequence[PersonCurve]) -> int:
    """Return the id of the subject: the only person, or the nearest one to its start; -1 = no person.

    Raises:
        UsageError: if there are several people and the start is unknown.
    """
    count = len({person.id for person in people})
    if not count:
        return -1
    if subject.start is None:
        if count > 1:
            raise UsageError(f"{count} people are there; state the subject's start in its file")
        return people[0].id
    places = [np.nanmedian(person.at(person.seen[:1])[0], axis=0) for person in people]
    return people[int(np.argmin(np.linalg.norm(np.array(places) - subject.start, axis=1)))].id


def with_subject_id(people: Sequence[PersonCurve], chosen: int, subject: int) -> list[PersonCurve]:
    """Return the people with the id of the subject, which tracking gives to no other person.

    Args:
        chosen: number of the subject among the people; -1 = no person.
        subject: id of the subject.
    """
    ids = {chosen: subject} if chosen >= 0 else {}
    return [replace(person, id=ids.get(person.id, person.id + (person.id >= subject))) for person in people]
