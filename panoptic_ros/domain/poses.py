"""3D poses (skeletons): without identity, tracked, refined."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from functools import partial
from math import isfinite
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain.checks import ShapeChecks, check_missing, check_scores, check_stamp
from panoptic_ros.domain.time_shift import TimeShift
from panoptic_ros.domain.view_sources import ViewSources
from panoptic_ros.errors import DataError

Array = np.ndarray


class JointState(IntEnum):
    """Source of a joint's position."""

    MISSING = 0
    MEASURED = 1  # from this instant's images
    PREDICTED = 2  # from earlier instants
    FILLED = 3  # from earlier and later instants, or from the rest of the body


_MISSING, _LAST = int(JointState.MISSING), int(max(JointState))  # enum members are slow to look up


@dataclass(frozen=True, slots=True, eq=False)
class PoseSet:
    """Skeletons of one instant.

    Args:
        index, stamp_ns: Those of the detection set.
        skeleton_hash: `SkeletonModel.hash`.
        positions: (P, J, 3) m in the world, NaN where missing.
        covariances: (P, J, 3, 3) m^2, NaN where missing.
        scores: (P, J) in 0..1, 0 where missing.
        views: (P, J) number of views behind the position.
        states: (P, J) `JointState`.
        person_scores: (P,) in 0..1.
        newest_ns: Timestamp of the newest view behind the skeletons, `stamp_ns` if negative.
        time_shift: Dependence of the positions on motion; None if all views have the same timestamp.
        sources: The views of the instant and their 2D poses; None if unknown.
        side_votes: (P, G) number of views that see each of the skeleton's G limbs with sides exchanged, minus
            the number that do not (see `solving.limbs`); None if not counted.
        corrections: (P, J, 3) m added against known detector errors, 0 where none was; None = nowhere.
            Positions compared with images, such as predictions, must exclude them.
    """

    index: int
    stamp_ns: int
    skeleton_hash: str
    positions: Array
    covariances: Array
    scores: Array
    views: Array
    states: Array
    person_scores: Array
    newest_ns: int = -1
    time_shift: TimeShift | None = None
    sources: ViewSources | None = None
    side_votes: Array | None = None
    corrections: Array | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "stamp_ns", check_stamp(self, self.stamp_ns))
        newest = self.stamp_ns if self.newest_ns < 0 else check_stamp(self, self.newest_ns, "newest_ns")
        object.__setattr__(self, "newest_ns", newest)
        shapes = ShapeChecks(self)
        positions = shapes.store("positions", np.float64, "P J 3")
        covariances = shapes.store("covariances", np.float64, "P J 3 3")
        scores = shapes.store("scores", np.float64, "P J")
        shapes.store("views", np.int32, "P J")
        states = shapes.store("states", np.uint8, "P J")
        check_scores(self, "scores", scores)
        check_scores(self, "person_scores", shapes.store("person_scores", np.float64, "P"))
        if states.size and states.max() > _LAST:
            raise DataError(f"PoseSet.states has the unknown state {states.max()}")
        there = states != _MISSING
        if not (isfinite(positions[there].sum()) and isfinite(covariances[there].sum())):
            self._check_missing(there)
        elif not there.all() and (scores[~there].any() or not np.isnan(positions[~there]).all()):
            self._check_missing(there)
        if not len(positions):
            object.__setattr__(self, "time_shift", None)
        elif self.time_shift is not None and self.time_shift.delays.shape[:2] != positions.shape[:2]:
            raise DataError(
                f"a time shift of {self.time_shift.delays.shape[:2]} people and joints for "
                f"{positions.shape[:2]}"
            )
        if self.sources is not None:
            self._check_sources(self.sources)
        if self.side_votes is not None:
            shapes.store("side_votes", np.float64, "P G")
        if (
            self.corrections is not None
            and not np.isfinite(shapes.store("corrections", np.float64, "P J 3")).all()
        ):
            raise DataError("PoseSet.corrections is not finite")

    def _check_missing(self, there: Array) -> None:
        """Check that present joints (P, J) are finite and missing ones NaN.

        Raises:
            DataError: otherwise.
        """
        check_missing(self, "positions", self.positions, self.scores)
        finite = np.isfinite(self.positions)
        known = finite.all(axis=-1) & np.isfinite(self.covariances).all(axis=(-2, -1))
        if (there & ~known).any():
            raise DataError("a joint that is not missing has a position or covariance that is not finite")
        if (finite.any(axis=-1) & ~there).any():
            raise DataError("a missing joint has a position; missing is NaN")

    def _check_sources(self, sources: ViewSources) -> None:
        """Check that the sources have one row per person, and drop them if they have no view.

        Raises:
            DataError: if the number of people differs.
        """
        if len(sources.persons) != len(self.positions):
            raise DataError(f"2D people of {len(sources.persons)} people for {len(self.positions)}")
        if not sources.cameras:
            object.__setattr__(self, "sources", None)


class Person(NamedTuple):
    """Person of one instant; arrays as in `PoseSet`, for J joints.

    Args:
        id: The same number is the same person over time.
        positions: (J, 3) m.
        covariances: (J, 3, 3) m^2.
        scores, views, states: (J,).
        score: Person score in 0..1.
    """

    id: int
    positions: Array
    covariances: Array
    scores: Array
    views: Array
    states: Array
    score: float


@dataclass(frozen=True, slots=True, eq=False)
class TrackedPoseSet(PoseSet):
    """Skeletons with identity.

    Args:
        ids: (P,) int64, unique within the set; the same number is the same person over time.
    """

    ids: Array = field(default_factory=partial(np.zeros, 0, np.int64))

    def __post_init__(self) -> None:
        PoseSet.__post_init__(self)
        ids = np.array(self.ids, np.int64).reshape(-1)
        if len(ids) != len(self.positions):
            raise DataError(f"{len(ids)} ids for {len(self.positions)} people")
        if len(set(ids.tolist())) != len(ids):
            raise DataError(f"an id appears twice among {ids.tolist()}")
        ids.flags.writeable = False
        object.__setattr__(self, "ids", ids)

    @property
    def people(self) -> tuple[Person, ...]:
        """Return the people as a tuple of `Person`."""
        joints = self.positions, self.covariances, self.scores, self.views, self.states
        return tuple(map(Person, self.ids.tolist(), *joints, self.person_scores.tolist()))


@dataclass(frozen=True, slots=True, eq=False)
class RefinedPoseSet(TrackedPoseSet):
    """Skeletons after refinement over time, for the instant `stamp_ns`."""

    def __post_init__(self) -> None:
        TrackedPoseSet.__post_init__(self)
