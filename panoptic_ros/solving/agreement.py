"""How well 2D people agree with skeletons, and with each other, in metres."""
from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.solving.scene import MIN_DEPTH

NOTHING = 50.0  # exponent beyond which an agreement counts as 0


@njit(cache=True, error_model="numpy")
def agreement_with_people(positions, shifts, seen, mirror, scale):
    """Mean agreement of every 2D person with every skeleton, as it is and with sides exchanged.

    The agreement of a joint is the Gaussian affinity exp(-d^2 / 2 scale^2). d is the residual times the
    depth, in metres, so near and far views count alike.

    Args:
        positions: (P, J, 3) m, NaN = unknown. shifts: (P, J, 3) m/s. seen: `Observations`.
        mirror: (J,) the joint on the other side. scale: m.

    Returns:
        straight, mirrored: (P, D) in 0..1, mean over the joints that both have;
        common: (P, D) number of such joints.
    """
    plane, precision, view = seen.plane, seen.precision, seen.views
    rotations, translations, delays = seen.cams
    people, joints = positions.shape[:2]
    straight = np.zeros((people, len(view)))
    mirrored = np.zeros((people, len(view)))
    common = np.zeros((people, len(view)), np.int64)
    factor = 0.5 / (scale * scale)
    u, w, z = np.empty(joints), np.empty(joints), np.empty(joints)
    for p in range(people):
        last = -1
        for d in range(len(view)):
            v = view[d]
            if v != last:
                last = v
                r = rotations[v]
                for j in range(joints):
                    a = positions[p, j, 0] + shifts[p, j, 0] * delays[v]
                    b = positions[p, j, 1] + shifts[p, j, 1] * delays[v]
                    c = positions[p, j, 2] + shifts[p, j, 2] * delays[v]
                    z[j] = r[2, 0] * a + r[2, 1] * b + r[2, 2] * c + translations[v, 2]
                    if not z[j] > MIN_DEPTH:
                        z[j] = 0.0
                        continue
                    u[j] = (r[0, 0] * a + r[0, 1] * b + r[0, 2] * c + translations[v, 0]) / z[j]
                    w[j] = (r[1, 0] * a + r[1, 1] * b + r[1, 2] * c + translations[v, 1]) / z[j]
            own = other = 0.0
            count = 0
            for j in range(joints):
                if z[j] <= 0.0 or precision[d, j] <= 0.0:
                    continue
                count += 1
                x, y, m = plane[d, j, 0], plane[d, j, 1], mirror[j]
                value = _agreement(factor * (((u[j] - x) ** 2 + (w[j] - y) ** 2) * z[j] * z[j]))
                own += value
                if m == j:
                    other += value
                elif z[m] > 0.0:
                    other += _agreement(factor * (((u[m] - x) ** 2 + (w[m] - y) ** 2) * z[m] * z[m]))
            if count > 0:
                straight[p, d], mirrored[p, d], common[p, d] = own / count, other / count, count
    return straight, mirrored, common


@njit(cache=True, error_model="numpy")
def _agreement(exponent):
    """exp(-exponent), or 0 where it is negligible; most people are far from most others."""
    return np.exp(-exponent) if exponent < NOTHING else 0.0


@njit(cache=True, error_model="numpy")
def agreement_of_pairs(chosen, seen, centres, scale):
    """Mean agreement (L, L) of the rays of 2D people `chosen` (L,), 0 inside a view; common (L, L).

    The agreement of a joint is exp(-d^2 / 2 scale^2) with the distance d of the two rays, and 0 if they meet
    behind a camera.
    """
    plane, precision, view, rotations = seen.plane, seen.precision, seen.views, seen.cams.rotations
    joints = plane.shape[1]
    count = len(chosen)
    rays = np.zeros((count, joints, 3))
    for i in range(count):
        d = chosen[i]
        r = rotations[view[d]]
        for j in range(joints):
            if precision[d, j] > 0.0:
                length = 0.0
                for k in range(3):
                    rays[i, j, k] = r[0, k] * plane[d, j, 0] + r[1, k] * plane[d, j, 1] + r[2, k]
                    length += rays[i, j, k] ** 2
                length = np.sqrt(length)
                for k in range(3):
                    rays[i, j, k] /= length
    values = np.zeros((count, count))
    common = np.zeros((count, count), np.int64)
    factor = 0.5 / (scale * scale)
    for i in range(count):
        for k in range(i + 1, count):
            va, vb = view[chosen[i]], view[chosen[k]]
            if va == vb:
                continue
            ox = centres[vb, 0] - centres[va, 0]
            oy = centres[vb, 1] - centres[va, 1]
            oz = centres[vb, 2] - centres[va, 2]
            total, n = 0.0, 0
            for j in range(joints):
                if precision[chosen[i], j] <= 0.0 or precision[chosen[k], j] <= 0.0:
                    continue
                n += 1
                a, b = rays[i, j], rays[k, j]
                cx = a[1] * b[2] - a[2] * b[1]
                cy = a[2] * b[0] - a[0] * b[2]
                cz = a[0] * b[1] - a[1] * b[0]
                sine2 = cx * cx + cy * cy + cz * cz
                if sine2 < 1e-6:
                    continue
                cosine = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
                along_a = a[0] * ox + a[1] * oy + a[2] * oz
                along_b = b[0] * ox + b[1] * oy + b[2] * oz
                if along_a - cosine * along_b <= 0.0 or cosine * along_a - along_b <= 0.0:
                    continue
                gap = ox * cx + oy * cy + oz * cz
                total += _agreement(factor * gap * gap / sine2)
            if n > 0:
                values[i, k] = values[k, i] = total / n
                common[i, k] = common[k, i] = n
    return values, common
