"""Designation of subjects among the people that cameras see."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain.checks import NOT_GIVEN, ShapeChecks, check_not_infinite, check_stamp
from panoptic_ros.errors import DataError

Array = np.ndarray
FIRST = -1  # value of `times` for the first instant at which a person is seen


@dataclass(frozen=True, slots=True, eq=False)
class SubjectSet:
    """Designated people (subjects); all other people are bystanders. An empty set designates no person.

    A subject is the track that is named. Without a track it is the person at the given place and time.
    Without a place it is the person seen first.

    Args:
        stamp_ns: Time of this designation, which replaces all earlier ones.
        ids: (S,) public identities of the subjects, distinct and not negative.
        places: (S, 3) m, pelvis position, NaN = not stated.
        times: (S,) ns, time at which the pelvis is there; `FIRST` = when the first people are seen.
        tracks: (S,) identities that tracking has assigned to them until now, -1 = not stated.

    Raises:
        DataError: if the arrays do not fit each other, or ids are negative or repeat.
    """

    stamp_ns: int
    ids: Array
    places: Array = NOT_GIVEN
    times: Array = NOT_GIVEN
    tracks: Array = NOT_GIVEN

    def __post_init__(self) -> None:
        object.__setattr__(self, "stamp_ns", check_stamp(self, self.stamp_ns))
        number = len(self.ids)
        for name, nothing in (
            ("places", np.full((number, 3), np.nan)),
            ("times", np.full(number, FIRST)),
            ("tracks", np.full(number, -1)),
        ):
            if getattr(self, name) is None:
                object.__setattr__(self, name, nothing)
        shapes = ShapeChecks(self)
        ids = shapes.store("ids", np.int64, "S")
        shapes.store("places", np.float64, "S 3")
        shapes.store("times", np.int64, "S")
        shapes.store("tracks", np.int64, "S")
        check_not_infinite(self, "places")
        if len(set(ids.tolist())) != len(ids) or (ids < 0).any():
            raise DataError(f"subjects have distinct ids from 0 on, found {ids.tolist()}")

    @classmethod
    def of_nobody(cls) -> SubjectSet:
        """Return a set that designates no person."""
        return cls(0, np.zeros(0, np.int64))
