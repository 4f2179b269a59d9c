"""Assignment of 2D poses to subjects by all pairs of views: Malleson et al. 2020, section 3.3.1, algorithm 1.

Every pair of 2D poses from two views is triangulated. Pairs with a small error become candidates in 3D, and
pairs at the same place join them. Each subject takes the candidate nearest to its last position. Candidates
that are near no subject are bystanders.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import Rig
from panoptic_ros.domain.subjects import InstantViews
from panoptic_ros.kinematics.body.sight import People

Array = np.ndarray
TRIANGULATION_ERROR = 0.015  # fraction of the image width, mean over the joints of both views: ThreshTriError
SAME_PERSON = 0.3  # m, mean distance of joints: ThreshDistSamePerson
MOVEMENT = 1.0  # m from the last position of a subject: ThreshInterframeMovement


class InstantPoses(NamedTuple):
    """All 2D poses of an instant.

    Attributes:
        cameras, rows: (R,), camera and row in its view.
        points, scores: (R, K, 2) on the normalised image plane, and (R, K).
    """

    cameras: Array
    rows: Array
    points: Array
    scores: Array


class PairwiseCandidate:
    """A person in 3D: mean joints over pairs of views, and rows of the 2D poses by camera."""

    def __init__(self, joints: Array):
        self._sums, self._counts = np.zeros_like(joints), np.zeros(len(joints), int)
        self.rows: dict[int, int] = {}

    @property
    def joints(self) -> Array:
        """Return the mean joints (K, 3) m of the pairs; NaN where no pair has the joint."""
        with np.errstate(invalid="ignore"):
            found: Array = self._sums / self._counts[:, None]
        return found

    def add(self, joints: Array, people: Sequence[tuple[int, int]]) -> None:
        """Add a pair of 2D poses. The first 2D pose of each camera counts.

        Args:
            joints: (K, 3) m, triangulated.
            people: Camera and row of both 2D poses.
        """
        known = np.isfinite(joints).all(-1)
        self._sums[known] += joints[known]
        self._counts += known
        for camera, row in people:
            self.rows.setdefault(camera, row)

    def apart(self, joints: Array) -> float:
        """Return the mean distance, m, from joints (K, 3); infinite without a joint in common."""
        far = np.linalg.norm(self.joints - joints, axis=-1)
        known = np.isfinite(far)
        return float(far[known].mean()) if known.any() else np.inf


class PairwiseSorter:
    """Assignment by pairs of views, with the last position of each subject.

    Args:
        starts: (3,) m, initial position of each subject; None = unknown.
    """

    def __init__(self, rig: Rig, starts: Sequence[Array | None]):
        self._places = list(starts)
        self._rotations = np.array([camera.cam_from_world.rotation for camera in rig.cameras])
        self._translations = np.array([camera.cam_from_world.translation for camera in rig.cameras])
        widths = [camera.image_size[0] / camera.intrinsics.matrix[0, 0] for camera in rig.cameras]
        self._limits = TRIANGULATION_ERROR * np.array(widths)  # on the normalised image plane

    def sort(self, instant: InstantViews, expected: Sequence[Array | None]) -> list[People]:
        """Return points (K, 2) and scores (K,) by camera, for each subject.

        Args:
            expected: (3,) m, middle of each body, for subjects that two views have not seen before.
        """
        self._places = [mine if mine is not None else other for mine, other in zip(self._places, expected)]
        left, views = self._candidates(instant), instant.views
        middles = [np.nanmedian(candidate.joints, axis=0) for candidate in left]
        found: list[People] = []
        for k, last in enumerate(self._places):
            far = [np.inf if last is None else float(np.linalg.norm(middle - last)) for middle in middles]
            if not far or min(far) > MOVEMENT:
                found.append({})
                continue
            nearest = int(np.argmin(far))
            self._places[k] = middles.pop(nearest)
            rows = left.pop(nearest).rows
            found.append({c: (views[c].points[row], views[c].scores[row]) for c, row in rows.items()})
        return found

    def _candidates(self, instant: InstantViews) -> list[PairwiseCandidate]:
        """Return all people whom two views or more see at one place."""
        seen = _all_of(instant)
        if seen is None:
            return []
        one, other = np.nonzero(seen.cameras[:, None] < seen.cameras[None, :])
        joints = self._triangulated(seen, one, other)
        fits = np.flatnonzero(self._errors(seen, one, other, joints) < 1.0)
        found: list[PairwiseCandidate] = []
        for n in fits.tolist():
            known = next((c for c in found if c.apart(joints[n]) < SAME_PERSON), None)
            if known is None:
                known = PairwiseCandidate(joints[n])
                found.append(known)
            pair = [(int(seen.cameras[r]), int(seen.rows[r])) for r in (one[n], other[n])]
            known.add(joints[n], pair)
        return found

    def _triangulated(self, seen: InstantPoses, one: Array, other: Array) -> Array:
        """Return the joints (N, K, 3) m of N pairs of 2D poses by linear triangulation.

        A joint that one of the two lacks is NaN.
        """
        normal, right = np.zeros((*seen.points[one].shape[:2], 3, 3)), 0.0
        for who in (one, other):
            plane, turned, moved = seen.points[who], self._rotations[seen.cameras[who]], self._translations
            rows = plane[..., None] * turned[:, None, 2:] - turned[:, None, :2]  # (N, K, 2, 3)
            shift = moved[seen.cameras[who]][:, None]
            values = shift[..., :2] - plane * shift[..., 2:]
            normal += rows.swapaxes(-1, -2) @ rows
            right = right + (rows.swapaxes(-1, -2) @ values[..., None])
        both = (seen.scores[one] > 0.0) & (seen.scores[other] > 0.0) & np.isfinite(normal).all((-1, -2))
        safe = np.where(both[..., None, None], normal + 1e-9 * np.eye(3), np.eye(3))
        found: Array = np.linalg.solve(safe, np.where(both[..., None, None], right, np.nan))[..., 0]
        return found

    def _errors(self, seen: InstantPoses, one: Array, other: Array, joints: Array) -> Array:
        """Return the mean reprojection errors (N,) of pairs, as fractions of their limits.

        The error is infinite for pairs without joints.
        """
        both = []
        for who in (one, other):
            cameras = seen.cameras[who]
            local = joints @ self._rotations[cameras].swapaxes(1, 2) + self._translations[cameras][:, None]
            with np.errstate(divide="ignore", invalid="ignore"):
                apart = np.linalg.norm(local[..., :2] / local[..., 2:] - seen.points[who], axis=-1)
            both.append(np.where(local[..., 2] <= 0.0, np.inf, apart) / self._limits[cameras][:, None])
        errors = 0.5 * (both[0] + both[1])
        count = np.isfinite(joints).all(-1).sum(-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            found: Array = np.where(count > 0, np.nansum(errors, axis=-1) / count, np.inf)
        return found


def _all_of(instant: InstantViews) -> InstantPoses | None:
    """Return all 2D poses of an instant; None without any."""
    there = [(camera, view) for camera, view in sorted(instant.views.items()) if len(view.points)]
    if not there:
        return None
    counts = [len(view.points) for _, view in there]
    cameras = np.repeat([camera for camera, _ in there], counts)
    parts = [(np.arange(len(view.points)), view.points, view.scores) for _, view in there]
    return InstantPoses(cameras, *(np.concatenate(part) for part in zip(*parts)))
