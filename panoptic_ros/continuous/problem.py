"""Curves of one person over a span of time: noise, stiffness and weights are learnt from the rays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from panoptic_ros.continuous.curves import (
    ORDER,
    AtRays,
    CurveFit,
    KnotGrid,
    WeightedRays,
    at_rays,
    fit_curves,
    persistence,
)
from panoptic_ros.continuous.follow import Entry
from panoptic_ros.continuous.seen_views import SeenViews
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.geometry.robust import growth
from panoptic_ros.geometry.splines import control_points
from panoptic_ros.solving.frames import CameraFrame
from panoptic_ros.solving.joint_noise import SCORE_BINS, JointNoiseModel

Array = np.ndarray
STEP_S = 0.04  # s between knots
ROUNDS = 10  # number of iterations in which weights, noise and stiffness are learnt
# share of a step that the stiffness takes, because whole steps overshoot; 12 half steps give the same
# With .7, ellipsoids of a runner before three cameras of 6.4 Hz hold .01 less
SHARE = 0.6
CAUCHY, FIRST_CAUCHY = 3.0, 30.0  # scale of the robust weights, in standard deviations: final, and at first
# m/s^2.5; a loose start, because robust weights reject the rays that a stiff curve misses
START_JERK = 1000.0
LEAST_JERK, MOST_JERK = 2.0, 2e4  # m/s^2.5
SMOOTHING_S = 0.5  # s, standard deviation of the weights in the average of the stiffness over time
LEAST_SURE = 0.02  # lower limit of the number of differences at a knot that the rays determine, of `axes`
# s of rays on both sides of a knot from which stiffness is learnt. A loose curve explains a false ray at an
# end of the rays, because no later ray contradicts it
INSIDE_S = 0.2
OUTSIDE = 1e-6  # weight of other knots, which counts where no knot within the average is inside
FIRST_NOISE = 2.5e-3  # on the normalised plane
# least share of the noise in residuals from which it is learnt: a curve that follows its rays hides the noise
LEAST_LEFT = 0.4
MEMORY_S = 0.2  # s, time constant of the persistent part of the noise
LEAST_DEPTH = 0.3  # m
MARGIN_S = 0.05  # s of curve beyond the outermost rays


@dataclass(frozen=True, slots=True, eq=False)
class LearntNoise:
    """Noise and stiffness of one person that were learnt from earlier rays.

    Args:
        factors: see `JointNoiseModel`.
        persistent: share of the noise variance that persists.
        stiffness: (J,) 1/m^2, at the end of the earlier rays.
    """

    factors: list[Array]
    persistent: float
    stiffness: Array


@dataclass(frozen=True, slots=True, eq=False)
class TrackRays:
    """N rays of one person, ordered by joint and time.

    Args:
        starts: (J + 1,) index of the first ray of each joint.
        joints, cameras: (N,) indices.
        stamps: (N,) s from the reference, on the cameras' own clocks.
        rows, rights: (N, 2, 3) and (N, 2), see `curves.WeightedRays`.
        scores: (N,) of the 2D joints.
        heights: (N,) px, image rows.
        depths: (N,) m, approximate depth of the person.
        squares: (N,) squared innovations of the association, see `motion.update`.
    """

    starts: Array
    joints: Array
    cameras: Array
    stamps: Array
    rows: Array
    rights: Array
    scores: Array
    heights: Array
    depths: Array
    squares: Array

    @classmethod
    def of(
        cls,
        entries: Sequence[Entry],
        frames: Sequence[CameraFrame],
        stamps: Array,
        arrays: RigArrays,
        mirror: Array,
    ) -> TrackRays:
        """Return the rays of the 2D people of a track.

        Args:
            stamps: (F,) s, of the frames.
            mirror: (J,) joint on the other side of each joint.
        """
        return cls.of_views(SeenViews.of(entries, frames, stamps, mirror), arrays)

    @classmethod
    def of_views(cls, seen: SeenViews, arrays: RigArrays) -> TrackRays:
        """Return the rays of the views of one person."""
        view, joint = np.nonzero(seen.scores > 0.0)
        order = np.lexsort((seen.times[view], joint))
        view, joint = view[order], joint[order]
        camera, point = seen.cameras[view], seen.plane[view, joint]
        rotations, translations = arrays.rotations[camera], arrays.translations[camera]
        return cls(
            np.searchsorted(joint, np.arange(seen.scores.shape[1] + 1)),
            joint,
            camera,
            seen.times[view],
            point[..., None] * rotations[:, None, 2] - rotations[:, :2],
            translations[:, :2] - point * translations[:, 2:],
            seen.scores[view, joint],
            seen.heights[view, joint],
            seen.depths[view],
            seen.squares[view, joint],
        )

    def subset(self, inside: Array) -> TrackRays:
        """Return the rays of a mask (N,)."""
        joints = self.joints[inside]
        others = [getattr(self, name)[inside] for name in self.__slots__[2:]]
        return TrackRays(np.searchsorted(joints, np.arange(len(self.starts))), joints, *others)

    def previous(self) -> Array:
        """Return the index (N,) of the previous ray of the same joint and camera, -1 = none."""
        order = np.lexsort((self.stamps, self.cameras, self.joints))
        same = np.diff(self.cameras[order], prepend=-1) == 0
        same &= np.diff(self.joints[order], prepend=-1) == 0
        found = np.full(len(order), -1)
        found[order[same]] = order[np.flatnonzero(same) - 1]
        return found


class CurveProblem:
    """Curves of one person and everything that is learnt with them.

    Args:
        rays: rays of the person.
        times: (N,) s, corrected timestamps of the rays.
        grid: knots of the curves.
        before: what earlier rays of the person have taught.
    """

    def __init__(
        self,
        rays: TrackRays,
        times: Array,
        arrays: RigArrays,
        grid: KnotGrid,
        before: LearntNoise | None = None,
    ):
        self.seen, self.times = rays, times
        self._depth_rows = arrays.rotations[rays.cameras, 2]
        self._depth_offsets = arrays.translations[rays.cameras, 2]
        joints = len(rays.starts) - 1
        factors = before.factors if before else first_factors(len(arrays.rotations), joints)
        self._noise = JointNoiseModel(rays.cameras, rays.joints, rays.scores, FIRST_NOISE, factors)
        self._previous = rays.previous()
        self.grid = grid
        self.inside = knots_inside(rays, times, grid)
        shape = (joints, self.grid.number - ORDER)
        self.stiffness = np.full(shape, 1.0 / (START_JERK**2 * STEP_S**5))
        self.depths = np.maximum(rays.depths, LEAST_DEPTH)
        self.persistent = 0.0
        if before is not None:
            self.persistent = before.persistent
            self.stiffness[:] = before.stiffness[:, None]
        self.misses = np.zeros((len(times), 2))  # m
        self._growths: Array = growth(rays.squares, CAUCHY)  # see `growths`

    @property
    def learnt(self) -> LearntNoise:
        """Return what was learnt, for later rays of the person."""
        return LearntNoise(self._noise.factors, self.persistent, self.stiffness[:, -1].copy())

    @property
    def growths(self) -> Array:
        """Return the factors (N,) by which residuals enlarge the variances of their rays.

        Innovations of the association take the place of residuals before there are curves.
        """
        return self._growths

    @property
    def sigmas(self) -> Array:
        """Return the standard deviations (N,) m of the rays at the joints."""
        sigmas: Array = self._noise.sigmas() * self.depths
        return sigmas

    @property
    def rays(self) -> WeightedRays:
        """Return the rays with their present weights."""
        seen = self.seen
        return WeightedRays(
            seen.starts,
            self.times,
            seen.rows,
            seen.rights,
            self.sigmas,
            self._growths,
            self._previous,
            self.persistent,
            MEMORY_S,
        )

    def fit(self) -> CurveFit:
        """Return the curves for the present weights."""
        fit: CurveFit = fit_curves(self.rays, self.grid, self.stiffness)
        return fit

    def compare(self, fit: CurveFit, cauchy: float = CAUCHY) -> AtRays:
        """Update residuals, depths and weights from curves.

        Args:
            cauchy: scale of the robust weights, in standard deviations.
        """
        at: AtRays = at_rays(fit, self.rays, self.grid)
        self.place(at.positions, cauchy)
        return at

    def place(self, positions: Array, cauchy: float = CAUCHY) -> None:
        """Update residuals, depths and weights from positions (N, 3) m of the joints at the rays."""
        self.misses = self.misses_of(positions)
        depths = np.einsum("ni,ni->n", self._depth_rows, positions) + self._depth_offsets
        self.depths = np.maximum(depths, LEAST_DEPTH)
        self._growths = growth(self.squares, cauchy)

    def misses_of(self, positions: Array) -> Array:
        """Return the residuals (N, 2) m of positions (N, 3) m of the joints at the rays."""
        misses: Array = np.einsum("nij,nj->ni", self.seen.rows, positions) - self.seen.rights
        return misses

    @property
    def squares(self) -> Array:
        """Return the squared residuals (N,) in units of the noise."""
        squares: Array = (self.misses**2).sum(1) / self.sigmas**2
        return squares

    def learn(self, fit: CurveFit, at: AtRays, cauchy: float = CAUCHY) -> None:
        """Update the noise, its persistent share and the stiffness of the prior, then the weights."""
        left = 1.0 - 0.5 * at.variances / self.sigmas**2  # share of the noise that is left in the residual
        ratios = np.sqrt(self.squares / np.maximum(left, LEAST_LEFT))
        self._noise.learn(ratios, left > LEAST_LEFT)
        self._growths = growth(self.squares, CAUCHY)
        self.persistent = persistence(fit, self.rays, self.grid, self.misses, at.variances)
        self._growths = growth(self.squares, cauchy)
        self.stiffness = learn_stiffness(self.stiffness, fit.differences, fit.spreads, self.inside)

    def solve(self, rounds: int = ROUNDS) -> CurveFit:
        """Return the curves after all iterations; the robust weights sharpen from one to the next.

        The noise is learnt with the final scale of the weights only. Before, outliers bend the curves, and a
        joint that some cameras see elsewhere would pass as a noisy one.
        """
        for k in range(rounds):
            fit, scale = self.fit(), cauchy_of(k + 1)
            at = self.compare(fit, scale)
            if scale > CAUCHY:
                self.stiffness = learn_stiffness(self.stiffness, fit.differences, fit.spreads, self.inside)
            else:
                self.learn(fit, at)
        fit = self.fit()
        self.compare(fit)
        return fit


def first_factors(cameras: int, joints: int) -> list[Array]:
    """Return the factors of `JointNoiseModel` before anything is learnt."""
    return [np.ones(SCORE_BINS), np.ones(cameras), np.ones(joints)]


def grid_over(times: Array, margin: float = MARGIN_S) -> KnotGrid:
    """Return the knots for rays at times (N,) s.

    Args:
        margin: (s) of curve beyond the outermost rays.
    """
    first, last = float(times.min()) - margin, float(times.max()) + margin
    return KnotGrid(first, STEP_S, control_points(first, last, STEP_S))


def cauchy_of(k: int) -> float:
    """Return the scale of the robust weights in iteration k, in standard deviations."""
    return max(CAUCHY, FIRST_CAUCHY / 2.0**k)


def knots_inside(rays: TrackRays, times: Array, grid: KnotGrid) -> Array:
    """Return the third differences (J, K - ORDER) that have rays of their joint on both sides.

    They are those `INSIDE_S` to 2 `INSIDE_S` away. A joint without any such difference has all.

    Args:
        times: (N,) s, corrected timestamps of the rays.
    """
    shape = (len(rays.starts) - 1, grid.number - ORDER)
    gap = round(INSIDE_S / grid.step)
    knots = np.clip(np.floor((times - grid.origin) / grid.step).astype(np.int64), 0, shape[1] - 1)
    counts = np.zeros((shape[0], shape[1] + 4 * gap + 1))
    np.add.at(counts, (rays.joints, knots + 2 * gap + 1), 1.0)
    total = counts.cumsum(axis=1)
    here = np.arange(shape[1]) + 2 * gap
    before = total[:, here - gap] - total[:, here - 2 * gap]
    after = total[:, here + 2 * gap] - total[:, here + gap]
    inside: Array = (before > 0.0) & (after > 0.0)
    inside[~inside.any(axis=1)] = True
    return inside


def learn_stiffness(
    stiffness: Array, differences: Array, spreads: Array, inside: Array, axes: int = 3
) -> Array:
    """Update the stiffness (J, K - ORDER) by a damped step of MacKay's rule, averaged over time.

    Args:
        differences, spreads, inside, axes: see `stiffness_sums`.
    """
    sure, squares = stiffness_sums(stiffness, differences, spreads, inside, axes)
    return within_limits(stiffness ** (1.0 - SHARE) * (sure / squares) ** SHARE)


def stiffness_sums(
    stiffness: Array, differences: Array, spreads: Array, inside: Array, axes: int | Array = 3
) -> tuple[Array, Array]:
    """Return the two sums (J, K - ORDER) whose ratio is the stiffness by MacKay's rule.

    The jerk of a joint changes over time: a recording of walking and running has no common value. So both
    are averages with Gaussian weights about each knot.

    Args:
        differences, spreads: see `CurveFit`.
        inside: (J, K - ORDER) see `knots_inside`.
        axes: number of free coordinates of a curve, over which `differences` and `spreads` are summed, or
            (J, 1) of each curve.

    Returns: the number of differences that the rays determine, and the squared differences, m^2.
    """
    sure = np.maximum(axes - spreads * stiffness, LEAST_SURE)
    weights = np.maximum(inside, OUTSIDE)
    sums = [
        gaussian_filter1d(weights * values, SMOOTHING_S / STEP_S, axis=1, mode="reflect", truncate=3.0)
        for values in (sure, differences)
    ]
    return sums[0], np.maximum(sums[1], 1e-20)


def within_limits(stiffness: Array) -> Array:
    """Return the stiffness within those of `MOST_JERK` and `LEAST_JERK`."""
    low, high = (1.0 / (jerk**2 * STEP_S**5) for jerk in (MOST_JERK, LEAST_JERK))
    clipped: Array = np.clip(stiffness, low, high)
    return clipped
