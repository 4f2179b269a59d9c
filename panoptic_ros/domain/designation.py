"""Who is designated among the people that cameras see."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain.checks import NOT_GIVEN, Shapes, check_not_infinite, check_stamp
from panoptic_ros.errors import DataError

Array = np.ndarray
FIRST = -1  # in place of a time: the first instant at which anybody is seen


@dataclass(frozen=True, slots=True, eq=False)
class SubjectSet:
    """The designated people; everybody else is a bystander. Empty: nobody is designated.

    A subject is the track that is named, else who is at the place at that time, else whoever is seen first.

    Args:
        stamp_ns: when this was said. It replaces what was said before.
        ids: (S,) public identities that the subjects have, distinct and not negative.
        places: (S, 3) m, where the pelvis is, NaN = not said.
        times: (S,) ns, when it is there; `FIRST` = when the first people are seen.
        tracks: (S,) identities that tracking has given to them until now, -1 = not said.

    Raises:
        DataError: if the arrays do not fit each other, or ids are negative or stand twice.
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
        shapes = Shapes(self)
        ids = shapes.store("ids", np.int64, "S")
        shapes.store("places", np.float64, "S 3")
        shapes.store("times", np.int64, "S")
        shapes.store("tracks", np.int64, "S")
        check_not_infinite(self, "places")
        if len(set(ids.tolist())) != len(ids) or (ids < 0).any():
            raise DataError(f"subjects have distinct ids from 0 on, found {ids.tolist()}")

    @classmethod
    def of_nobody(cls) -> SubjectSet:
        """Nobody is designated."""
        return cls(0, np.zeros(0, np.int64))
