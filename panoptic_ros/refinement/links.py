"""Displacements of joints between two instants, measured on the surface, as filter measurements; compiled.

A displacement d = p' - p + noise of covariance S links two states. The process is x' = F x + w with w of
covariance Q, and H selects the position. The following is exact (a filter with delayed state; Brown and
Hartman 1968):

1. d measures the previous velocity v: d = dt v + noise of covariance H Q H^T + S.
2. The transition becomes x' = F x + K (d - dt v) + noise of covariance Q - K H Q.

The gain is K = Q H^T (H Q H^T + S)^-1. If the state has an acceleration, its displacement adds to dt v. The
smoother needs only the gains of this transition.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import PartMotions
from panoptic_ros.geometry.robust import relative_growth
from panoptic_ros.geometry.rotations import rotation_of
from panoptic_ros.kernels import njit
from panoptic_ros.refinement.kalman import update_row
from panoptic_ros.refinement.small_matrices import cholesky, solve, whiten, whitened_row

Array = np.ndarray


class JointDisplacements(NamedTuple):
    """Displacements of the joints of P people since the previous moment."""

    displacements: Array  # (P, J, 3) m, NaN = not measured
    spreads: Array  # (P, J, 3, 3) m^2, their covariances


def links_of(
    motions: PartMotions, joints: list[list[int]], ids: Array, states: Array
) -> JointDisplacements | None:
    """Return the displacements of joints according to the motions of parts; None if there are none.

    Displacements of parts that share a joint are averaged with their information as weights.

    Args:
        motions: Motions of parts since the previous moment.
        joints: Joints of each part.
        ids: (P,) ids of the people.
        states: (P, J, S) states of the joints at the previous moment.
    """
    row_of = {number: row for row, number in enumerate(ids.tolist())}
    means, totals = np.zeros((*states.shape[:2], 3)), np.zeros((*states.shape[:2], 3, 3))
    rotation = np.empty((3, 3))
    for k, (person, part) in enumerate(zip(motions.people.tolist(), motions.parts.tolist())):
        if person not in row_of or part >= len(joints):
            continue
        row, own = row_of[person], joints[part]
        places = states[row, own, :3]
        rotation_of(motions.rotations[k], rotation)
        arms = places - motions.centres[k]
        turned = arms @ rotation.T
        jacobians = np.zeros((len(own), 3, 6))
        jacobians[:, range(3), range(3, 6)] = 1.0
        jacobians[:, 0, 1], jacobians[:, 0, 2], jacobians[:, 1, 2] = turned[:, 2], -turned[:, 1], turned[:, 0]
        jacobians[:, 1, 0], jacobians[:, 2, 0], jacobians[:, 2, 1] = (
            -turned[:, 2],
            turned[:, 1],
            -turned[:, 0],
        )
        spreads = jacobians @ motions.covariances[k] @ np.swapaxes(jacobians, 1, 2)
        known = np.isfinite(places[:, 0])
        inverses = np.linalg.inv(spreads[known])
        means[row, np.array(own)[known]] += np.einsum(
            "nij,nj->ni", inverses, (turned - arms + motions.translations[k])[known]
        )
        totals[row, np.array(own)[known]] += inverses
    there = totals[..., 0, 0] > 0.0
    if not there.any():
        return None
    found = JointDisplacements(np.full(means.shape, np.nan), np.zeros(totals.shape))
    found.spreads[there] = np.linalg.inv(totals[there])
    found.displacements[there] = np.einsum("nij,nj->ni", found.spreads[there], means[there])
    return found


def with_views(links: JointDisplacements, rows: Array, moved: Array, spreads: Array) -> JointDisplacements:
    """Return the links combined with displacements from views.

    Such a displacement is the difference of two measurements of a joint. Errors of views persist for many
    frames, for example while a limb is hidden. So the difference is more accurate than each measurement, and
    corrects errors of surface tracking. Joints without a link get none.

    Args:
        rows: (R,) rows of the people that views measured.
        moved: (R, J, 3) m, displacements from views, NaN = not measured.
        spreads: (R, J, 3, 3) m^2, their covariances.
    """
    displacements, own = links.displacements.copy(), links.spreads.copy()
    row, joint = np.nonzero(np.isfinite(displacements[rows, :, 0] + moved[..., 0]))
    there = rows[row], joint
    surface, views = np.linalg.inv(own[there]), np.linalg.inv(spreads[row, joint])
    own[there] = np.linalg.inv(surface + views)
    sums = surface @ displacements[there][..., None] + views @ moved[row, joint][..., None]
    displacements[there] = (own[there] @ sums)[..., 0]
    return JointDisplacements(displacements, own)


@njit(cache=True, error_model="numpy")
def predict_linked(sized, motion, transition, noise, links, cauchy, ahead, gains, innovations):
    """Predict joints with measured displacements into `ahead`, and write their smoother gains to `gains`.

    This replaces `kalman.predict` and `kalman.smoother_gains` for these joints. Their previous state is first
    updated with the velocity that the displacement measures. Large innovations increase the covariance of the
    displacement (`geometry.robust`).

    Args:
        motion: Filtered motion of the previous moment, updated.
        noise: (P, J) m^2/s^3, process noise.
        cauchy: standard deviations, scale of the Cauchy weight.
        ahead: Motion after the transition, output.
        gains: (P, J, S, S), transposed, output.
        innovations: (P, J, 3), output: whitened innovations of the displacements; other joints stay
            unchanged.
    """
    size, forward, shape = len(sized), transition.forward, transition.spread
    total, lower, spread, inverse = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    row, gain, change, white = np.empty(size), np.empty(size), np.empty(3), np.empty(3)
    step, factor = np.empty((size, size)), np.empty((size, size))
    orders = size // 3
    for p, j in np.ndindex(noise.shape):
        state, cov, q = motion.states[p, j], motion.covariances[p, j], noise[p, j]
        moved, own = links.displacements[p, j], links.spreads[p, j]
        if not np.isfinite(moved[0] + state[0]):
            continue
        for i in range(3):
            change[i] = moved[i]
            for m in range(1, orders):
                change[i] -= forward[0, m] * state[i + 3 * m]
            for k in range(3):
                total[i, k] = own[i, k]
                for m in range(1, orders):
                    for n in range(1, orders):
                        total[i, k] += forward[0, m] * forward[0, n] * cov[i + 3 * m, k + 3 * n]
            total[i, i] += q * shape[0, 0]
        cholesky(total, lower, False)
        whiten(lower, change, innovations[p, j])
        squared = 0.0
        for k in range(3):
            squared += innovations[p, j, k] ** 2 / 3.0
        growth = relative_growth(squared, cauchy)
        for i in range(3):
            for k in range(3):
                spread[i, k] = own[i, k] * growth
                total[i, k] = spread[i, k]
            total[i, i] += q * shape[0, 0]
        inverse[:] = np.linalg.inv(total)
        # transition given the displacement: step = F - K (H F - H), K = Q H^T inverse
        step[:] = 0.0
        for i in range(size):
            for m in range(i // 3, orders):
                step[i, i % 3 + 3 * m] = forward[i // 3, m]
            for k in range(3):
                for m in range(1, orders):
                    step[i, k + 3 * m] -= q * shape[i // 3, 0] * inverse[i % 3, k] * forward[0, m]
        cholesky(total, lower, False)
        for k in range(3):  # update of the previous state
            whitened_row(lower, k, white)
            value, row[:] = 0.0, 0.0
            for i in range(3):
                value += white[i] * moved[i]
                for m in range(1, orders):
                    row[i + 3 * m] = forward[0, m] * white[i]
            for i in range(3, size):
                value -= row[i] * state[i]
            update_row(sized, state, cov, row, value, np.inf, gain)
        later, grown, gains_here = ahead.states[p, j], ahead.covariances[p, j], gains[p, j]
        for i in range(size):
            later[i] = 0.0
            for k in range(size):
                later[i] += step[i, k] * state[k]
            for k in range(3):
                later[i] += q * shape[i // 3, 0] * inverse[i % 3, k] * moved[k]
        for i in range(size):
            for k in range(size):
                factor[i, k] = 0.0
                for m in range(size):
                    factor[i, k] += step[i, m] * cov[m, k]
        for i in range(size):
            for k in range(size):
                grown[i, k] = 0.0
                for m in range(size):
                    grown[i, k] += factor[i, m] * step[k, m]
                grown[i, k] -= q * q * shape[i // 3, 0] * shape[k // 3, 0] * inverse[i % 3, k % 3]
                gains_here[i, k] = factor[i, k]
            for m in range(i % 3, size, 3):
                grown[i, m] += q * shape[i // 3, m // 3]
        solve(sized, grown, gains_here, factor)
