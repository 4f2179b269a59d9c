"""Recent observations of one person, interpolated at any instant: 2D joints by camera, and 3D joints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from panoptic_ros.domain import JointState, TrackedPoseSet
from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.kernels import njit
from panoptic_ros.kinematics.body.sight import People

Array = np.ndarray
KEPT_NS = 250_000_000  # ns, time before a camera's newest sample for which older samples are kept
NEAR_NS = 1_000  # ns within which a sample is used unchanged: frame periods are not whole numbers of ns
LONGEST_GAP_NS = 150_000_000  # ns, longest interval over which joints are interpolated
SEVERAL = 2  # minimum number of agreeing views that measured a joint whose 3D position is used


class ViewJoints(NamedTuple):
    """2D joints of one person in a view.

    Attributes:
        stamp_ns: Timestamp, ns.
        points: (K, 2) on the normalised image plane, NaN = missing.
        scores: (K,).
    """

    stamp_ns: int
    points: Array
    scores: Array


class JointPositions(NamedTuple):
    """3D joints of one person.

    Attributes:
        stamp_ns: Timestamp, ns.
        positions: (K, 3) m, NaN = missing.
        covariances: (K, 3, 3) m^2.
    """

    stamp_ns: int
    positions: Array
    covariances: Array


Seen = TypeVar("Seen", ViewJoints, JointPositions)


class PersonSamples:
    """Newest samples of one person."""

    def __init__(self) -> None:
        self.views: dict[int, list[ViewJoints]] = {}  # by camera
        self.joints: list[JointPositions] = []

    def see(self, camera: int, seen: ViewJoints) -> None:
        """Add the 2D joints from a camera."""
        own = self.views.setdefault(camera, [])
        own.append(seen)
        _forget_old(own)

    def take_joints(self, joints: JointPositions) -> None:
        """Add 3D joints that another stage has solved for."""
        self.joints.append(joints)
        _forget_old(self.joints)

    def views_at(self, stamp_ns: int, half_period_ns: int, told: Array | None = None) -> People:
        """Return points (K, 2) and scores (K,) of every camera at an instant.

        Joints are interpolated linearly between the samples before and after the instant. If only one of
        these samples exists, it is used if it is within half a period of the instant. A joint that is in the
        nearer sample only is used under the same condition. A joint that is in the farther sample only is
        missing.

        Args:
            told: (K,) bool, joints to leave out, because the caller has them in another form.
        """
        cameras: list[int] = []
        begins: list[ViewJoints] = []
        ends: list[ViewJoints] = []
        shares: list[float] = []
        near: list[bool] = []
        for camera, own in sorted(self.views.items()):
            pair = _pair(*_around(own, stamp_ns), stamp_ns, half_period_ns)
            if pair is not None:
                cameras.append(camera)
                begins.append(pair[0])
                ends.append(pair[1])
                shares.append(pair[2])
                near.append(pair[3])
        if not cameras:
            return {}
        points, scores = _stacked(begins)
        told = np.zeros(scores.shape[1], bool) if told is None else told
        _mix(points, scores, *_stacked(ends), np.array(shares), np.array(near), told)
        return {camera: (points[k], scores[k]) for k, camera in enumerate(cameras)}

    def joints_at(self, stamp_ns: int, half_period_ns: int) -> tuple[Array, Array] | None:
        """Return 3D joints at an instant: positions (K, 3) m and covariances (K, 3, 3) m^2.

        The result is None if no sample is near the instant.
        """
        found = self._joints_about(stamp_ns, half_period_ns)
        return found if found is not None and np.isfinite(found[0]).any() else None

    def _joints_about(self, stamp_ns: int, half_period_ns: int) -> tuple[Array, Array] | None:
        begin, end = _around(self.joints, stamp_ns)
        if begin is None or end is None or end.stamp_ns - begin.stamp_ns > LONGEST_GAP_NS:
            one = _nearest(begin, end, stamp_ns, half_period_ns)
            return None if one is None else (one.positions, one.covariances)
        share = _share(begin.stamp_ns, end.stamp_ns, stamp_ns)
        nearest = begin if share < 0.5 else end
        if share in (0.0, 1.0):
            return nearest.positions, nearest.covariances
        return (1.0 - share) * begin.positions + share * end.positions, nearest.covariances


def joints_as_seen(item: TrackedPoseSet, model: SegmentModel, several: bool = False) -> Array:
    """Return the 3D joints (P, J, 3) m.

    If the model has the detector's offsets, they are the positions at which the detector places the joints:
    the corrections of detector biases are removed.

    Args:
        several: True for only those joints that several views measured; all others are NaN.
    """
    positions = item.positions
    if model.offsets and item.corrections is not None:
        positions = positions - item.corrections
    if several:
        measured = (item.states == JointState.MEASURED) & (item.views >= SEVERAL)
        positions = np.where(measured[..., None], positions, np.nan)
    return positions


def _forget_old(own: list[Seen]) -> None:
    """Discard from `own` the samples older than KEPT_NS, except for the newest of these."""
    while len(own) > 2 and own[1].stamp_ns < own[-1].stamp_ns - KEPT_NS:
        del own[0]


def _stacked(samples: Sequence[ViewJoints]) -> tuple[Array, Array]:
    """Return points (V, K, 2) and scores (V, K)."""
    return np.array([one.points for one in samples]), np.array([one.scores for one in samples])


def _around(own: Sequence[Seen], stamp_ns: int) -> tuple[Seen | None, Seen | None]:
    """Return the newest sample that is not after an instant, and the oldest that is not before it."""
    before: Seen | None = None
    after: Seen | None = None
    for sample in reversed(own):
        if sample.stamp_ns >= stamp_ns:
            after = sample
        if sample.stamp_ns <= stamp_ns:
            before = sample
            break
    return before, after


def _nearest(begin: Seen | None, end: Seen | None, stamp_ns: int, within_ns: int) -> Seen | None:
    there = [one for one in (begin, end) if one is not None and abs(one.stamp_ns - stamp_ns) <= within_ns]
    return min(there, key=lambda one: abs(one.stamp_ns - stamp_ns), default=None)


def _share(begin_ns: int, end_ns: int, stamp_ns: int) -> float:
    if stamp_ns - begin_ns <= NEAR_NS:
        return 0.0
    return 1.0 if end_ns - stamp_ns <= NEAR_NS else (stamp_ns - begin_ns) / (end_ns - begin_ns)


def _pair(
    begin: ViewJoints | None, end: ViewJoints | None, stamp_ns: int, half_period_ns: int
) -> tuple[ViewJoints, ViewJoints, float, bool] | None:
    """Return two samples, the weight of the later one, and whether joints of the nearer one alone are used.

    A single usable sample is returned twice. The result is None if no sample is usable.
    """
    if begin is None or end is None or end.stamp_ns - begin.stamp_ns > LONGEST_GAP_NS:
        one = _nearest(begin, end, stamp_ns, half_period_ns)
        return None if one is None else (one, one, 0.0, True)
    share = _share(begin.stamp_ns, end.stamp_ns, stamp_ns)
    if share in (0.0, 1.0):
        one = begin if share == 0.0 else end
        return one, one, 0.0, True
    near = min(stamp_ns - begin.stamp_ns, end.stamp_ns - stamp_ns) <= half_period_ns
    return begin, end, share, near


@njit(cache=True, error_model="numpy", nogil=True)
def _mix(
    begin: Array, begin_scores: Array, end: Array, end_scores: Array, shares: Array, near: Array, told: Array
) -> None:
    """Interpolate points (V, K, 2) and scores (V, K) between two samples, into the arrays of the first.

    Args:
        shares: (V,), weights of the later sample.
        near: (V,) bool. True: a joint that is in one sample only is taken from the nearer sample. A joint
            that is in the farther sample only is always missing.
        told: (K,) bool, joints to leave out.
    """
    for v in range(len(begin)):
        share = shares[v]
        for k in range(begin.shape[1]):
            x = (1.0 - share) * begin[v, k, 0] + share * end[v, k, 0]
            y = (1.0 - share) * begin[v, k, 1] + share * end[v, k, 1]
            score = (1.0 - share) * begin_scores[v, k] + share * end_scores[v, k]
            both = begin_scores[v, k] > 0.0 and end_scores[v, k] > 0.0
            if told[k] or not (both and np.isfinite(x) and np.isfinite(y)):
                x, y, score = np.nan, np.nan, 0.0
                if near[v] and not told[k]:
                    if share < 0.5:
                        x, y, score = begin[v, k, 0], begin[v, k, 1], begin_scores[v, k]
                    else:
                        x, y, score = end[v, k, 0], end[v, k, 1], end_scores[v, k]
            begin[v, k, 0], begin[v, k, 1], begin_scores[v, k] = x, y, score
