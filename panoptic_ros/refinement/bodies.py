"""Joints that few views see, from solved bodies: their bones keep their lengths and poses stay human.

A body has joints elsewhere than the detector has them, by much the same in the frame of the hips. What well
seen joints are off is learnt per person and joint, and so is how much that varies. The body rests in part on
the same 2D joints, so both are not independent: what comes out is taken to be as certain as the better of the
two. With IMUs it knows much more than two views do, whose errors last: what smoothing took off these is put
back. Where one view or none sees a joint, neither is right as a rule: skeletons hold on to what more views
saw before, bodies to lengths and to how people move. Their covariances decide. Where both are farther apart
than these say, nothing tells which is wrong, and both are as much less certain (Birge 1932).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.domain.bodies import BodyStateSet
from panoptic_ros.geometry.rotations import from_quaternions
from panoptic_ros.refinement.joint_states import FILLED, MEASURED, MISSING, Judged

Array = np.ndarray
WELL_SEEN = 3  # views of a joint that is left as it is, and learnt from
REACH_NS = 100_000_000  # for which a body is carried on by its velocity
KEPT_NS = 500_000_000  # for which bodies are kept
SPREAD, BELIEF = 0.02, 3.0  # m per axis, of bodies of which nothing is learnt, and what it counts, in looks
MEMORY = 50.0  # looks
CAUCHY = 3.0  # sigma, by which a body and a skeleton are apart, beyond which both are less certain
FILLED_SCORE = 0.25  # of a joint that no view has seen


class Posed(NamedTuple):
    """Bodies of an instant: stamp; ids (B,); IMUs (B,) behind them; keypoints (B, J, 3) m, their covariances
    (B, J, 3, 3) m^2; hips (B, 3, 3), world from segment."""

    stamp_ns: int
    ids: Array
    devices: Array
    points: Array
    covariances: Array
    hips: Array


class Learnt(NamedTuple):
    """Of a person: looks (J,), offsets (J, 3) m in the frame of the hips, variances (J,) m^2 per axis."""

    looks: Array
    offsets: Array
    variances: Array


class BodyFill:
    """Bodies lately, and what is learnt of them."""

    def __init__(self) -> None:
        self._kept: list[Posed] = []
        self._learnt: dict[int, Learnt] = {}

    def take(self, item: BodyStateSet, biases: Array) -> None:
        """Bodies of one more instant; those that go back in time begin anew.

        Args:
            biases: (J, 3, 3) m^2 of the detector, which bodies state. Skeletons have the same: they do not
                count between both.
        """
        if self._kept and item.stamp_ns <= self._kept[-1].stamp_ns:
            self._kept = []
        hips = from_quaternions(np.ascontiguousarray(item.orientations[:, 0]))
        points, spreads = item.keypoints, item.keypoint_covariances - biases
        self._kept.append(Posed(item.stamp_ns, item.ids, item.devices, points, spreads, hips))
        while self._kept[0].stamp_ns < item.stamp_ns - KEPT_NS:
            self._kept.pop(0)

    def fill(
        self, stamp_ns: int, ids: Array, judged: Judged, views: Array, noises: Array, max_sigma: float
    ) -> None:
        """Learn from joints that are well seen, and mend all others, in place.

        Args:
            ids: (P,) of the people. views: (P, J) behind joints that are measured.
            noises: (P, J, 3, 3) m^2, of their latest measurements.
            max_sigma: m, of missing joints that are filled.
        """
        for row, number in enumerate(ids.tolist()):
            body = self._at(stamp_ns, number)
            if body is None:
                continue
            points, spreads, hips, worn = body
            learnt = self._learnt.get(number) or nothing_learnt(len(points))
            well = (judged.states[row] == MEASURED) & (views[row] >= WELL_SEEN)
            apart = (judged.positions[row] - points) @ hips
            own = np.trace(judged.covariances[row] + noises[row], axis1=-2, axis2=-1) / 3.0
            self._learnt[number] = learnt = learn(learnt, apart, own, well & np.isfinite(apart).all(-1))
            placed = points + learnt.offsets @ hips.T
            noise = spreads + learnt.variances[:, None, None] * np.eye(3)
            _mend(judged, row, placed, noise, worn * noises[row], ~well, max_sigma)

    def _at(self, stamp_ns: int, number: int) -> tuple[Array, Array, Array, bool] | None:
        """Keypoints (J, 3), covariances and hips of a person at an instant, by the two bodies next to it, and
        whether there were IMUs."""
        own = [(posed, rows[0]) for posed in self._kept if len(rows := np.flatnonzero(posed.ids == number))]
        if not own:
            return None
        after = next((k for k, (posed, _) in enumerate(own) if posed.stamp_ns >= stamp_ns), len(own) - 1)
        (begin, b), (end, e) = own[max(after - 1, 0)], own[after]
        near, n = (end, e) if abs(end.stamp_ns - stamp_ns) <= abs(begin.stamp_ns - stamp_ns) else (begin, b)
        if abs(near.stamp_ns - stamp_ns) > REACH_NS:
            return None
        points = near.points[n]
        if 0 < end.stamp_ns - begin.stamp_ns <= REACH_NS:
            share = (stamp_ns - begin.stamp_ns) / (end.stamp_ns - begin.stamp_ns)
            points = begin.points[b] + share * (end.points[e] - begin.points[b])
        return points, near.covariances[n], near.hips[n], bool(near.devices[n])


def nothing_learnt(joints: int) -> Learnt:
    """Of somebody who is new."""
    return Learnt(np.zeros(joints), np.zeros((joints, 3)), np.full(joints, SPREAD**2))


def learn(learnt: Learnt, apart: Array, own: Array, well: Array) -> Learnt:
    """With one more look at the joints (J,) that are well seen.

    Args:
        apart: (J, 3) m, by which they are off the body's. own: (J,) m^2 per axis, of that by themselves.
    """
    looks = learnt.looks + well
    far = np.where(well[:, None], apart - learnt.offsets, 0.0)
    gain = well * np.maximum(1.0 / np.maximum(looks, 1.0), 1.0 / MEMORY)
    slow = well * np.maximum(1.0 / (looks + BELIEF), 1.0 / MEMORY)
    more = np.maximum((far**2).mean(axis=-1) - np.where(well, own, 0.0), 0.0)
    variances = learnt.variances + slow * (more - learnt.variances)
    return Learnt(looks, learnt.offsets + gain[:, None] * far, variances)


def _mend(
    judged: Judged, row: int, placed: Array, noise: Array, measured: Array, asked: Array, max_sigma: float
) -> None:
    """Joints of a person with what the body says: places (J, 3) m of noise (J, 3, 3) m^2, as measurements."""
    told = asked & np.isfinite(placed).all(-1) & np.isfinite(noise).all((-2, -1))
    gone = judged.states[row] == MISSING
    sure = np.sqrt(np.trace(np.where(told[:, None, None], noise, 0.0), axis1=-2, axis2=-1) / 3.0) < max_sigma
    for j in np.flatnonzero(told & gone & sure).tolist():
        judged.positions[row, j], judged.covariances[row, j] = placed[j], noise[j]
        judged.states[row, j], judged.scores[row, j] = FILLED, FILLED_SCORE
    both = np.flatnonzero(told & ~gone)
    own, other = judged.covariances[row, both] + measured[both], noise[both]
    far = (placed[both] - judged.positions[row, both])[..., None]
    odd = (far.swapaxes(1, 2) @ np.linalg.solve(own + other, far))[:, 0, 0]
    less = (1.0 + odd / CAUCHY**2)[:, None, None]
    own, other = own * less, other * less
    judged.positions[row, both] += (own @ np.linalg.solve(own + other, far))[..., 0]
    better = np.trace(other, axis1=-2, axis2=-1) < np.trace(own, axis1=-2, axis2=-1)
    judged.covariances[row, both] = np.where(better[:, None, None], other, own)
