"""People as they are reported at instants: scores, numbers of views and states of their joints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import JointState, RefinedPoseSet
from panoptic_ros.kernels import njit
from panoptic_ros.solving.calibration_errors import CalibrationErrors

Array = np.ndarray
ABSENT_S = 0.5  # s without a view after which a person is not reported
MOST_SIGMA = 0.2  # m per axis, greatest standard deviation (RMS) of a joint that is reported
LEAST_SCORE, PREDICTED_SCORE = 0.01, 0.1  # scores of joints that are not missing: measured, and others


class RayEvidence(NamedTuple):
    """N rays behind the curves of a person, ordered by joint and time.

    Args:
        starts: (J + 1,) index of the first ray of each joint.
        times: (N,) s.
        cameras: (N,) indices.
        weights: (N,) scores of the 2D joints times robust weights, 0..1.
    """

    starts: Array
    times: Array
    cameras: Array
    weights: Array

    @classmethod
    def of(cls, starts: Array, times: Array, cameras: Array, weights: Array) -> RayEvidence:
        """Return the evidence of rays that are ordered by joint alone."""
        order = time_order(starts, times)
        return cls(starts, times[order], cameras[order], weights[order])


class JointReport(NamedTuple):
    """Joints of one person at T instants; missing joints are NaN.

    Args:
        positions: (T, J, 3) m.
        covariances: (T, J, 3, 3) m^2.
        scores: (T, J) in 0..1, 0 = missing.
        views: (T, J) number of cameras that see the joint within one period of the instant.
        states: (T, J) `JointState`.
    """

    positions: Array
    covariances: Array
    scores: Array
    views: Array
    states: Array

    def at(self, k: int) -> JointReport:
        """Return the arrays of instant k, without their first axis."""
        return JointReport(*(values[k] for values in self))


def was_seen(times: Array, seen: Array) -> Array:
    """Return whether a person was seen in the ABSENT_S before instants (T,) s.

    Args:
        seen: (V,) s, sorted times of the views that show the person, at least one.
    """
    since = times - seen[np.maximum(np.searchsorted(seen, times, "right") - 1, 0)]
    here: Array = (since >= 0.0) & (since <= ABSENT_S)
    return here


def joint_report(
    times: Array,
    positions: Array,
    covariances: Array,
    evidence: RayEvidence,
    period: float,
    derived: Sequence[tuple[int, tuple[int, ...]]] = (),
) -> JointReport:
    """Return the joints of a person at increasing instants (T,) s.

    Args:
        positions: (T, J, 3) m, overwritten.
        covariances: (T, J, 3, 3) m^2, overwritten.
        period: (s) time between two frames of a camera. A joint without a ray that near is predicted.
        derived: joints that are means of others, see `SkeletonModel`.
    """
    views, scores, later = near_rays(times, *evidence, period)
    for joint, sources in derived:
        own = list(sources)
        positions[:, joint] = positions[:, own].mean(axis=1)
        covariances[:, joint] = covariances[:, own].sum(axis=1) / len(own) ** 2
        views[:, joint], scores[:, joint] = views[:, own].min(axis=1), scores[:, own].min(axis=1)
        later[:, joint] = later[:, own].all(axis=1)
    states = np.where(
        views > 0, JointState.MEASURED, np.where(later, JointState.FILLED, JointState.PREDICTED)
    ).astype(np.uint8)
    sigma = np.sqrt(np.trace(covariances, axis1=-2, axis2=-1) / 3.0)
    missing = ~(sigma <= MOST_SIGMA) | ~np.isfinite(positions).all(axis=-1)
    scores = np.where(views > 0, np.clip(scores, LEAST_SCORE, 1.0), PREDICTED_SCORE)
    states[missing], scores[missing], views[missing] = JointState.MISSING, 0.0, 0
    positions[missing], covariances[missing] = np.nan, np.nan
    return JointReport(positions, covariances, scores, views, states)


def add_calibration(
    report: JointReport,
    times: Array,
    evidence: RayEvidence,
    period: float,
    derived: Sequence[tuple[int, tuple[int, ...]]],
    calibration: CalibrationErrors | None,
) -> None:
    """Add the covariance of the calibration to a report at increasing instants (T,) s, in place.

    Arguments are those of `joint_report`. A camera counts if it sees the joint within one period.

    Args:
        calibration: Errors of the rig's calibration; None = unknown.
    """
    if calibration is None:
        return
    shape = report.views.shape
    used = np.zeros((*shape, len(calibration.focals)), bool)
    for joint in range(shape[1]):
        rays = slice(evidence.starts[joint], evidence.starts[joint + 1])
        seen, cameras = evidence.times[rays], evidence.cameras[rays]
        counts = np.zeros((len(times) + 1, used.shape[2]), np.int64)
        np.add.at(counts, (np.searchsorted(times, seen - period), cameras), 1)
        np.add.at(counts, (np.searchsorted(times, seen + period, "right"), cameras), -1)
        used[:, joint] = counts.cumsum(axis=0)[:-1] > 0
    for joint, sources in derived:
        used[:, joint] = used[:, list(sources)].all(axis=1)
    added = calibration.covariances(report.positions.reshape(-1, 3), used.reshape(-1, used.shape[2]))
    report.covariances[...] += added.reshape(report.covariances.shape)


def add_biases(report: JointReport, floors: Sequence[float]) -> None:
    """Add the covariance of the detector's constant biases to a report, in place.

    Args:
        floors: (J,) m, see `SkeletonModel.bias_floors`; () = unknown.
    """
    if len(floors):
        report.covariances[...] += np.square(floors)[:, None, None] * np.eye(3)


@njit(cache=True, error_model="numpy", nogil=True)
def time_order(starts, times):
    """Return the order (N,) of rays by joint and time."""
    order = np.empty(len(times), np.int64)
    for j in range(len(starts) - 1):
        begin, end = starts[j], starts[j + 1]
        order[begin:end] = begin + np.argsort(times[begin:end], kind="mergesort")
    return order


@njit(cache=True, error_model="numpy", nogil=True)
def near_rays(instants, starts, times, cameras, weights, period):
    """Summarise the rays within `period` of each of T increasing instants, for J joints.

    Args:
        starts, times, cameras, weights: see `RayEvidence`.

    Returns: the number of cameras (T, J), the mean weight (T, J), and whether later rays exist (T, J).
    """
    shape = (len(instants), len(starts) - 1)
    views, scores = np.zeros(shape, np.int64), np.zeros(shape)
    later = np.zeros(shape, np.bool_)
    newest = np.full(cameras.max() + 1 if len(cameras) else 1, -1)  # last instant with the camera
    for j in range(shape[1]):
        end = starts[j + 1]
        low = high = starts[j] + np.searchsorted(times[starts[j] : end], instants[0] - period)
        newest[:] = -1
        for i in range(len(instants)):
            while low < end and times[low] < instants[i] - period:
                low += 1
            while high < end and times[high] <= instants[i] + period:
                high += 1
            later[i, j] = high < end
            total = 0.0
            for n in range(low, high):
                total += weights[n]
                views[i, j] += newest[cameras[n]] != i
                newest[cameras[n]] = i
            scores[i, j] = total / max(high - low, 1)
    return views, scores, later


def pose_set(
    index: int,
    stamp_ns: int,
    skeleton_hash: str,
    joints: int,
    people: Sequence[tuple[int, JointReport]],
    newest_ns: int = -1,
) -> RefinedPoseSet:
    """Return the people of one instant.

    Args:
        joints: number of joints.
        people: ids and joints, see `JointReport.at`.
        newest_ns: see `PoseSet`.
    """
    shapes = ((joints, 3), (joints, 3, 3), (joints,), (joints,), (joints,))
    columns = zip(*(report for _, report in people)) if people else ((),) * len(shapes)
    positions, covariances, scores, views, states = (
        np.stack(rows) if rows else np.empty((0, *shape)) for rows, shape in zip(columns, shapes)
    )
    return RefinedPoseSet(
        index,
        stamp_ns,
        skeleton_hash,
        positions,
        covariances,
        scores,
        views,
        states,
        scores.mean(axis=1) if people else np.empty(0),
        newest_ns,
        ids=np.array([number for number, _ in people], np.int64),
    )
