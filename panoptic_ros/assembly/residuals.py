"""Choice of the residuals that show the noise of 2D joints, and their correction for leverage."""

from __future__ import annotations

import numpy as np

from panoptic_ros.geometry.symmetric import invert_symmetric
from panoptic_ros.kernels import njit
from panoptic_ros.solving.scene import seen_at

MOST = 1000  # approximate maximum number of residuals per instant
# scale of the coordinates whose digits decide which observations are used, if there are more than MOST
THINNING = 1e7
LEVERAGE = 0.7  # largest leverage of a used observation; at leverage 1 its residual is always 0
TWO_VIEW_LEVERAGE = 0.9  # largest leverage of a used observation of a joint of two views
TWO_VIEW_FACTOR = 1.2345  # two views leave one residual: |N(0, 1)| has another median than a 2D length


@njit(cache=True, error_model="numpy")
def residuals_to_learn(kept, solved, shifts, seen, focals):
    """Return rows (N,), joints (N,) and residuals (N,) px of observations of the people `kept` (P,).

    The residuals are those of joints that three or more views show. Only if there are none, those of two
    views are used. If there are too many residuals, about every n-th is used. It is selected by the digits of
    its observation, so the order of the views does not matter. Observations beyond the gate are included,
    because their residuals are noise.

    Args:
        solved: `SolvedJoints`.
        shifts: (P, J, 3) m/s, velocities with which views were moved to the instant of the set.
        seen: `SceneObservations`.
        focals: (V,) px.
    """
    positions, normals, residuals, picks = solved
    plane, (joints, views) = seen.plane, residuals.shape[1:]
    support = np.zeros((len(kept), joints), np.int64)
    few = True
    for i in range(len(kept)):
        for j in range(joints):
            if np.isfinite(positions[kept[i], j, 0]):
                for v in range(views):
                    support[i, j] += residuals[kept[i], j, v] >= 0.0
                few &= support[i, j] < 3
    least = 2 if few else 3
    count = 0
    for i in range(len(kept)):
        for j in range(joints):
            if support[i, j] >= least:
                for v in range(views):
                    count += picks[kept[i], j, v, 0] >= 0
    stride = 1 + count // MOST
    rows, columns = np.empty(count, np.int64), np.empty(count, np.int64)
    pixels, spread = np.empty(count), np.zeros((3, 3))
    taken = 0
    for i in range(len(kept)):
        p = kept[i]
        for j in range(joints):
            if support[i, j] < least:
                continue
            invert_symmetric(normals[p, j], 1.0, spread)
            for v in range(views):
                d, s = picks[p, j, v]
                if d < 0:
                    continue
                if stride > 1 and np.int64(THINNING * abs(plane[d, s, 0] + plane[d, s, 1])) % stride:
                    continue
                error, leverage = _residual(positions[p, j], shifts[p, j], spread, seen, v, d, s)
                if residuals[p, j, v] < 0.0:
                    leverage = 0.0
                if leverage < (TWO_VIEW_LEVERAGE if few else LEVERAGE):
                    rows[taken], columns[taken] = d, s
                    pixels[taken] = error * focals[v] / np.sqrt(max(1.0 - leverage, 0.1))
                    if few:
                        pixels[taken] *= TWO_VIEW_FACTOR
                    taken += 1
    return rows[:taken], columns[:taken], pixels[:taken]


@njit(cache=True, error_model="numpy")
def _residual(x, shift, spread, seen, v, d, s):
    """Return the distance on the plane between a joint and its observation, and the observation's leverage.

    Args:
        x: (3,) m, world, position of the joint.
        shift: (3,) m/s, velocity.
        spread: (3, 3) m^2, inverse of the joint's normal matrix.
    """
    u, w, depth = seen_at(seen.cams, v, x, shift, seen.delays[d, s])
    r, row, total = seen.cams.rotations[v], np.empty(3), 0.0  # trace of J N^-1 J^T
    for i in range(2):
        for k in range(3):
            row[k] = r[i, k] - (u if i == 0 else w) * r[2, k]
        for k in range(3):
            for m in range(3):
                total += row[k] * spread[k, m] * row[m]
    error = np.sqrt((seen.plane[d, s, 0] - u) ** 2 + (seen.plane[d, s, 1] - w) ** 2)
    return error, 0.5 * total * (seen.precision[d, s] / depth) ** 2
