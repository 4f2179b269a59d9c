"""Body of a person without a subject file: lengths from the person's skeletons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from panoptic_ros.domain.segments import SHORTEST, TALLEST, SegmentedBody, SegmentModel
from panoptic_ros.domain.subjects import Subject
from panoptic_ros.kinematics.body.evidence import EvidenceBuilder
from panoptic_ros.kinematics.body.lengths import LengthEstimate
from panoptic_ros.kinematics.body.start import first_pose
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.pose.prior import PoseStatistics
from panoptic_ros.kinematics.pose.solve import solve_pose
from panoptic_ros.kinematics.pose.targets import NO_TURNS, NO_VIEWS, no_anchor

Array = np.ndarray
MOST = 16  # maximum number of skeletons that are kept
LEAST_LIMBS = 5  # minimum number of limbs in a skeleton that is used
ACROSS = 1  # axis of the trunk that points to the left
ROUNDS = 3  # alternations between the estimation of lengths and of poses
ITERATIONS = 20
UNORIENTED = np.zeros(0, np.int64), np.zeros((0, 3, 3))


class MeasuredBody:
    """Body estimate from the skeletons of one person, which come one by one.

    The kept skeletons are spread evenly over the time since the first, because errors of consecutive
    skeletons are correlated.
    """

    def __init__(self) -> None:
        self._seen: list[tuple[Array, Array]] = []
        self._count, self._stride = 0, 1

    def take(
        self,
        config: KinematicsConfig,
        model: SegmentModel,
        statistics: PoseStatistics,
        joint_names: Sequence[str],
        joints: tuple[Array, Array],
    ) -> SegmentedBody | None:
        """Add a skeleton, and return the body if an update is due, else None.

        An update is due at the first skeleton and whenever the number of skeletons has doubled.

        A limb is a segment whose proximal joint and whose parent's proximal joint are joints of the skeleton.
        The stature is the median over the limbs of the stature that explains each limb. From there on,
        lengths are those that explain the joints in any pose, as for lengths from motion (see `lengths`). The
        distances between paired joints of one segment, such as eyes or ears, are taken from the skeletons
        directly.

        Args:
            joints: Positions (J, 3) m, NaN = missing, and covariances (J, 3, 3) m^2.

        Returns:
            The body; None if no update is due or the skeleton has too few limbs.
        """
        limbs = limbs_of(model, joint_names)
        if not len(limbs) or np.isfinite(_apart(joints[0][None], limbs)).sum() < LEAST_LIMBS:
            return None
        if self._count % self._stride == 0:
            self._seen.append((np.array(joints[0]), np.array(joints[1])))
        self._count += 1
        if len(self._seen) > MOST:
            self._seen, self._stride = self._seen[::2], 2 * self._stride
        if self._count & (self._count - 1):
            return None
        seen = np.array([positions for positions, _ in self._seen])
        typical = _typical(_apart(seen, limbs))
        shares = np.array([np.linalg.norm(model.shares[s]) for s, _, _ in limbs])
        known = np.isfinite(typical)
        stature = float(np.median(typical[known] / shares[known]))
        body = model.body(float(np.clip(stature, SHORTEST, TALLEST)))
        body = replace(body.with_keypoints(_pairs_of(body, joint_names, seen)), own=frozenset())
        for _ in range(ROUNDS):
            body = _fitted(config, statistics, joint_names, body, self._seen)
        return body


def limbs_of(model: SegmentModel, joint_names: Sequence[str]) -> list[tuple[int, int, int]]:
    """Return the limbs: segment, and joints of the skeleton at its parent's and at its own proximal joint."""
    at = _joints_at(model, joint_names)
    return [
        (s, at[int(model.parents[s])], at[s])
        for s in at
        if int(model.parents[s]) in at and model.names[s][0] in "lr"
    ]


def _joints_at(model: SegmentModel, joint_names: Sequence[str]) -> dict[int, int]:
    """Return the joint of the skeleton at the proximal joint of each segment that has one."""
    return {
        model.index(segment): list(joint_names).index(name)
        for name, (segment, share) in model.keypoints.items()
        if name in joint_names and not np.any(share)
    }


def _fitted(
    config: KinematicsConfig,
    statistics: PoseStatistics,
    joint_names: Sequence[str],
    body: SegmentedBody,
    seen: Sequence[tuple[Array, Array]],
) -> SegmentedBody:
    """Return the body with lengths estimated from skeletons, with left and right equal."""
    subject, model = Subject(0, body), body.model
    weighing = EvidenceBuilder(config, subject, statistics, None, joint_names)
    estimate, anchor = LengthEstimate(model, body.offsets), no_anchor(len(model.names))
    pose = first_pose(weighing, subject, {}, UNORIENTED, seen[0])
    for joints in seen:
        evidence = weighing.evidence(NO_VIEWS, NO_TURNS, weighing.points(joints))
        hessian = np.empty((model.freedoms, model.freedoms))
        solve_pose(body.chain, pose, evidence, anchor, ITERATIONS, hessian)
        estimate.look(body.chain, pose, evidence)
    estimate.update()
    return body.with_offsets(dict(zip(model.names, estimate.offsets())))


def _pairs_of(body: SegmentedBody, joint_names: Sequence[str], seen: Array) -> dict[str, tuple[str, Array]]:
    """Return keypoints of the detector's paired joints on one segment.

    Their distance is the median one in skeletons (N, J, 3) m.
    """
    found, columns = {}, {name: k for k, name in enumerate(joint_names)}
    for left, (segment, _) in body.keypoints.items():
        right = f"r{left[1:]}"
        if left[0] != "l" or right not in body.keypoints or body.keypoints[right][0] != segment:
            continue
        if left not in columns or right not in columns:
            continue
        apart = np.linalg.norm(seen[:, columns[left]] - seen[:, columns[right]], axis=-1)
        width = _typical(apart[:, None])[0]
        if np.isfinite(width):
            for name, side in ((left, 1.0), (right, -1.0)):
                place = np.array(body.keypoints[name][1])
                place[ACROSS] = 0.5 * side * width
                found[name] = (body.model.names[segment], place)
    return found


def _apart(positions: Array, limbs: Sequence[tuple[int, int, int]]) -> Array:
    """Return the lengths (N, L) m of limbs in skeletons (N, J, 3) m."""
    begin, end = np.array([b for _, b, _ in limbs]), np.array([e for _, _, e in limbs])
    found: Array = np.linalg.norm(positions[:, end] - positions[:, begin], axis=-1)
    return found


def _typical(values: Array) -> Array:
    """Return the medians (L,) of the finite values in the columns of (N, L); NaN without any."""
    found = np.full(values.shape[1], np.nan)
    for k, column in enumerate(values.T):
        known = column[np.isfinite(column)]
        if len(known):
            found[k] = np.median(known)
    return found
