"""Lengths of a body from its motion: visible joints determine them in any pose.

At single instants, the pose and the lengths are solved for together, and the pose is eliminated. The
remaining information about the lengths is averaged over instants. Averages are used because the joints of a
detector have about the same errors at all instants. All data are therefore treated as only a few independent
observations. Left and right lengths are equal.

`LengthTransition` introduces new lengths gradually, because an instantaneous change would make limbs jump.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from panoptic_ros.domain.segments import SegmentedBody, SegmentModel
from panoptic_ros.geometry.chain import Pose, place_segments, place_sites
from panoptic_ros.geometry.segment_chain import Chain
from panoptic_ros.kinematics.pose.normal_equations import assemble
from panoptic_ros.kinematics.pose.targets import PointTargets, PoseEvidence, ViewTargets, no_anchor

Array = np.ndarray

LASTS_S = 0.5
LENGTH_SD = 0.05  # fraction of a length, standard deviation given the stature
LOOKS = 10.0  # maximum number of independent observations
# fraction of the stature. Smaller components of an offset are constant: no length scales them.
LEAST_SHARE = 0.02
NEAREST = 0.1  # m, minimum depth in front of a camera


class LengthTransition:
    """Gradual change from one set of offsets to those of a body, along half a cosine.

    Args:
        begin: (S, 3) m, current offsets.
    """

    def __init__(self, begin: Array, body: SegmentedBody):
        self._begin, self._body, self._passed_s = begin.copy(), body, 0.0

    @property
    def is_over(self) -> bool:
        """Return whether the change is complete."""
        return self._passed_s >= LASTS_S

    def after(self, seconds: float) -> SegmentedBody:
        """Advance by `seconds` and return the body at that time."""
        self._passed_s += seconds
        if self.is_over:
            return self._body
        share = 0.5 - 0.5 * math.cos(math.pi * self._passed_s / LASTS_S)
        offsets = self._begin + share * (self._body.offsets - self._begin)
        return self._body.with_offsets(dict(zip(self._body.model.names, offsets)))


def lengths_of(model: SegmentModel) -> tuple[tuple[tuple[int, int], ...], ...]:
    """Return all lengths of a skeleton, each as the components of offsets that scale together.

    A component is a segment and an axis. Left and right share a length, and so do numbered segments, such as
    those of the spine.
    """
    groups: dict[tuple[str, int], list[tuple[int, int]]] = {}
    for s, name in enumerate(model.names):
        paired = name[:1] in "lr" and name[1:2].isupper()
        kind = (name[1:] if paired else name).rstrip("0123456789")
        for axis in range(3):
            if abs(model.shares[s, axis]) >= LEAST_SHARE:
                groups.setdefault((kind, axis), []).append((s, axis))
    return tuple(tuple(parts) for parts in groups.values())


class LengthEstimate:
    """Estimate of the offsets (S, 3) m of one person.

    Args:
        offsets: (S, 3) m, derived from the stature.
        sure: Number of independent observations that all data with a common error count as, see `spreads`.
    """

    def __init__(self, model: SegmentModel, offsets: Array, sure: float = LOOKS):
        self._usual, self._sure = offsets.copy(), sure
        self._lengths = lengths_of(model)
        count = len(self._lengths)
        self._information, self._pull = np.zeros((count, count)), np.zeros(count)
        self.looks = 0
        self.scales: Array = np.zeros(count)
        self._unsure = LENGTH_SD**2 * np.eye(count)  # covariance of the current scales
        self._moved = np.zeros((len(offsets), 3, count))

    def offsets(self) -> Array:
        """Return the current offsets (S, 3) m."""
        found = self._usual.copy()
        for scale, length in zip(self.scales, self._lengths):
            for s, axis in length:
                found[s, axis] *= math.exp(scale)
        return found

    def spreads(self) -> Array:
        """Return the covariances (S, 3, 3) m^2 of segment positions due to uncertain lengths.

        They are in the frame of the first segment. The pose adapts to a change of lengths as at the last
        observation (a consider covariance, Schmidt 1966).
        """
        found: Array = self._moved @ self._unsure @ self._moved.swapaxes(1, 2)
        return found

    def look(self, chain: Chain, pose: Pose, evidence: PoseEvidence) -> None:
        """Learn from an instant whose pose was solved with this chain.

        Args:
            evidence: All evidence of the instant, with views or 3D joints.
        """
        size = 3 + 3 * len(chain.parents)
        hessian, gradient = np.empty((size, size)), np.empty(size)
        assemble(chain, pose, evidence, no_anchor(len(chain.parents)), hessian, gradient)
        grown = self._grown(chain, pose)
        parts = (
            _view_slopes(chain, pose, evidence.views, grown),
            _point_slopes(chain, pose, evidence.points, grown),
        )
        by_pose, by_length, residuals = (np.concatenate(rows) for rows in zip(*parts))
        cross = by_length.T @ by_pose
        inner = cho_factor(hessian + 1e-6 * np.eye(size), check_finite=False)
        solved = cho_solve(inner, np.column_stack([cross.T, gradient]), check_finite=False)
        information = by_length.T @ by_length - cross @ solved[:, :-1]
        pull = by_length.T @ residuals - cross @ solved[:, -1] - information @ self.scales
        self._moved = self._by_lengths(chain, pose, grown, solved[:, :-1])
        self.looks += 1
        self._information += (information - self._information) / self.looks
        self._pull += (pull - self._pull) / self.looks

    def update(self) -> float:
        """Apply the learnt lengths and return the largest change of an offset, m."""
        before = self.offsets()
        looks = min(float(self.looks), LOOKS)
        precision = np.diag(np.full(len(self.scales), LENGTH_SD**-2))
        gain = np.linalg.inv(looks * self._information + precision)
        self.scales = -gain @ (looks * self._pull)
        told = looks**2 / min(looks, self._sure) * self._information
        self._unsure = gain @ (precision + told) @ gain
        return float(np.linalg.norm(self.offsets() - before, axis=-1).max())

    def _by_lengths(self, chain: Chain, pose: Pose, grown: Array, given_way: Array) -> Array:
        """Return the derivatives (S, 3, L) of segment positions by the lengths.

        They are in the frame of the first segment.

        Args:
            grown: The same in the world, for a constant pose.
            given_way: (D, L), derivatives of the pose by the lengths, with opposite sign.
        """
        segments = np.arange(len(chain.parents))
        slopes = np.empty((len(segments), 3, len(given_way)))
        place_sites(chain, pose, segments, np.zeros((len(segments), 3)), slopes)
        found: Array = pose.turns[0].T @ (grown - slopes @ given_way)
        return found

    def _grown(self, chain: Chain, pose: Pose) -> Array:
        """Return the derivatives (S, 3, L) of proximal joints by the lengths, for a constant pose.

        They are in the world frame.
        """
        count = len(chain.parents)
        frames, places = np.empty((count, 3, 3)), np.empty((count, 3))
        place_segments(chain, pose, frames, places)
        grown = np.zeros((count, 3, len(self._lengths)))
        for k, length in enumerate(self._lengths):
            for s, axis in length:
                grown[s, :, k] += frames[chain.parents[s], :, axis] * chain.offsets[s, axis]
        for s in range(1, count):
            grown[s] += grown[chain.parents[s]]
        return grown


def _view_slopes(chain: Chain, pose: Pose, views: ViewTargets, grown: Array) -> tuple[Array, Array, Array]:
    """Return derivatives by pose (2 N, D) and lengths (2 N, L), and weighted residuals (2 N,)."""
    slopes = np.empty((len(views.segments), 3, 3 + 3 * len(chain.parents)))
    sites = place_sites(chain, pose, views.segments, views.offsets, slopes)
    rotation = views.rotations[views.cameras]
    local = (rotation @ sites[..., None])[..., 0] + views.translations[views.cameras]
    depth = np.maximum(local[:, 2], NEAREST)
    plane = local[:, :2] / depth[:, None]
    apart = plane - views.points
    error = views.weights * (apart**2).sum(-1)
    weight = np.sqrt(np.where(local[:, 2] > NEAREST, views.weights * _kept(error, views.scale), 0.0))
    across = (rotation[:, :2] - plane[..., None] * rotation[:, 2:]) * (weight / depth)[:, None, None]
    return _rows(across, slopes), _rows(across, grown[_anchors(views)]), (apart * weight[:, None]).ravel()


def _point_slopes(chain: Chain, pose: Pose, points: PointTargets, grown: Array) -> tuple[Array, Array, Array]:
    """Return the three arrays of `_view_slopes` for 3D joints: (3 N, D), (3 N, L) and (3 N,)."""
    slopes = np.empty((len(points.segments), 3, 3 + 3 * len(chain.parents)))
    sites = place_sites(chain, pose, points.segments, points.offsets, slopes)
    apart = (sites - points.goals)[..., None]
    error = (apart.swapaxes(1, 2) @ points.information @ apart)[:, 0, 0]
    kept = np.sqrt(_kept(error, points.scale))[:, None, None]
    halves = kept * np.linalg.cholesky(points.information).swapaxes(1, 2)
    return _rows(halves, slopes), _rows(halves, grown[_anchors(points)]), (halves @ apart).ravel()


def _anchors(targets: ViewTargets | PointTargets) -> Array:
    """Return the segments (N,) with which the sites move if lengths change."""
    return targets.anchors if len(targets.anchors) else targets.segments


def _kept(error: Array, scale: float) -> Array:
    """Return the factors (N,) by which Cauchy's loss reduces weights.

    Args:
        error: (N,) weighted squared residuals.
    """
    found: Array = 1.0 / (1.0 + error / scale) if scale > 0.0 else np.ones(len(error))
    return found


def _rows(weights: Array, slopes: Array) -> Array:
    """Return the derivatives of weighted residuals as rows (K N, M).

    Args:
        weights: (N, K, 3), weights of K residuals per site.
        slopes: (N, 3, M), derivatives of the sites.
    """
    found: Array = (weights @ slopes).reshape(-1, slopes.shape[-1])
    return found
