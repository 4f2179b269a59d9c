"""Displacements of joints that were measured on the surface, between one instant and the next; compiled.

A displacement d = p' - p + noise of covariance S ties two states together. With the process x' = F x + w, w
of covariance Q, and H the rows of positions, it is taken exactly (a filter with a delayed state; Brown and
Hartman 1968): first d measures the velocity v before, d = dt v + noise of covariance H Q H^T + S; then
x' = F x + K (d - dt v) + noise of covariance Q - K H Q with K = Q H^T (H Q H^T + S)^-1. The smoother needs
nothing but its gains from that transition.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import PartMotions
from panoptic_ros.geometry.robust import relative_growth
from panoptic_ros.geometry.rotations import rotation_of
from panoptic_ros.kernels import njit
from panoptic_ros.refinement.kalman import update_row
from panoptic_ros.refinement.small_matrices import cholesky, solve, whitened_row

Array = np.ndarray


class Links(NamedTuple):
    """Displacements of the joints of P people since the moment before."""

    displacements: Array  # (P, J, 3) m, NaN = not measured
    spreads: Array  # (P, J, 3, 3) m^2


def links_of(motions: PartMotions, joints: list[list[int]], ids: Array, states: Array) -> Links | None:
    """What parts say of the joints of people with these ids (P,), in states (P, J, 6); None if nothing.

    Parts that share a joint are averaged by their covariances.

    Args:
        joints: of each part.
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
    found = Links(np.full(means.shape, np.nan), np.zeros(totals.shape))
    found.spreads[there] = np.linalg.inv(totals[there])
    found.displacements[there] = np.einsum("nij,nj->ni", found.spreads[there], means[there])
    return found


def with_views(links: Links, rows: Array, moved: Array, spreads: Array) -> Links:
    """Links with what views say of the same motion: the difference of two measurements of a joint.

    Errors of views last for many frames, as a limb that is hidden stays so. So their difference is known
    better than each of them, and corrects a surface that was followed wrongly. What has no link gets none.

    Args:
        rows: (R,) of the people that views measured. moved: (R, J, 3) m, NaN = not.
        spreads: (R, J, 3, 3) m^2.
    """
    displacements, own = links.displacements.copy(), links.spreads.copy()
    row, joint = np.nonzero(np.isfinite(displacements[rows, :, 0] + moved[..., 0]))
    there = rows[row], joint
    surface, views = np.linalg.inv(own[there]), np.linalg.inv(spreads[row, joint])
    own[there] = np.linalg.inv(surface + views)
    sums = surface @ displacements[there][..., None] + views @ moved[row, joint][..., None]
    displacements[there] = (own[there] @ sums)[..., 0]
    return Links(displacements, own)


@njit(cache=True, error_model="numpy")
def predict_linked(motion, dt, noise, links, cauchy, ahead, gains, innovations):
    """`kalman.predict` and `kalman.smoother_gains` of the joints that were measured to move, in place.

    Their motion before is updated with what its velocity was. Large innovations multiply the covariance of
    the displacement (`geometry.robust`).

    Args:
        noise: (P, J) m^2/s^3. ahead: the motion dt s later. gains: (P, J, 6, 6), transposed.
        innovations: (P, J, 3) become those of the displacements, whitened; others stay.
    """
    total, lower, row, gain = np.empty((3, 3)), np.empty((3, 3)), np.empty(6), np.empty(6)
    spread, inverse, step, factor = np.empty((3, 3)), np.empty((3, 3)), np.empty((6, 6)), np.empty((6, 6))
    softness = 1.0 / (cauchy * cauchy)
    for p, j in np.ndindex(noise.shape):
        state, cov, q = motion.states[p, j], motion.covariances[p, j], noise[p, j]
        moved, own = links.displacements[p, j], links.spreads[p, j]
        if not np.isfinite(moved[0] + state[0]):
            continue
        place, cross = q * dt**3 / 3.0, q * dt**2 / 2.0
        for i in range(3):
            for k in range(3):
                total[i, k] = own[i, k] + dt * dt * cov[3 + i, 3 + k]
            total[i, i] += place
        cholesky(total, lower, False)
        squared = 0.0
        for k in range(3):
            whitened_row(lower, k, row[:3])
            value = 0.0
            for i in range(3):
                value += row[i] * (moved[i] - dt * state[3 + i])
            squared += value * value / 3.0
            innovations[p, j, k] = value
        growth = relative_growth(squared, softness)
        for i in range(3):
            for k in range(3):
                spread[i, k] = own[i, k] * growth
                total[i, k] = spread[i, k]
            total[i, i] += place
        inverse[:] = np.linalg.inv(total)
        # given the displacement: K = [place I; cross I] inverse
        step[:] = 0.0
        for i in range(3):
            step[i, i], step[i, 3 + i], step[3 + i, 3 + i] = 1.0, dt, 1.0
            for k in range(3):
                step[i, 3 + k] -= dt * place * inverse[i, k]
                step[3 + i, 3 + k] -= dt * cross * inverse[i, k]
        cholesky(total, lower, False)
        for k in range(3):  # the velocity before
            whitened_row(lower, k, gain[:3])
            value = 0.0
            for i in range(3):
                row[i], row[3 + i] = 0.0, dt * gain[i]
                value += gain[i] * (moved[i] - dt * state[3 + i])
            update_row(state, cov, row, value, np.inf, gain)
        later, grown = ahead.states[p, j], ahead.covariances[p, j]
        for i in range(6):
            later[i] = 0.0
            for k in range(6):
                later[i] += step[i, k] * state[k]
        for i in range(3):
            for k in range(3):
                later[i] += place * inverse[i, k] * moved[k]
                later[3 + i] += cross * inverse[i, k] * moved[k]
        for i in range(6):
            for k in range(6):
                factor[i, k] = 0.0
                for m in range(6):
                    factor[i, k] += step[i, m] * cov[m, k]
        for i in range(6):
            for k in range(6):
                grown[i, k] = 0.0
                for m in range(6):
                    grown[i, k] += factor[i, m] * step[k, m]
                gains[p, j, i, k] = factor[i, k]
        for i in range(3):
            grown[i, i] += place
            grown[i, 3 + i] += cross
            grown[3 + i, i] += cross
            grown[3 + i, 3 + i] += q * dt
            for k in range(3):
                grown[i, k] -= place * place * inverse[i, k]
                grown[i, 3 + k] -= place * cross * inverse[i, k]
                grown[3 + i, k] -= place * cross * inverse[i, k]
                grown[3 + i, 3 + k] -= cross * cross * inverse[i, k]
        solve(grown, gains[p, j], factor)
