"""Agreement of 2D poses with skeletons and with each other: Gaussian affinities of distances in metres."""

from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.solving.scene import MIN_DEPTH, seen_at
from panoptic_ros.solving.triangulation import viewing_ray

NOTHING = 50.0  # exponent from which an agreement is set to 0: exp(-50) = 2e-22


@njit(cache=True, error_model="numpy")
def agreement_with_people(positions, shifts, seen, mirror, scale):
    """Return the mean agreement of every 2D pose with every skeleton, straight and with exchanged sides.

    The agreement of a joint is the Gaussian affinity exp(-d^2 / (2 scale^2)). The distance d in m is the
    residual on the plane at 1 m times the depth of the joint. So near and far views count alike.

    Args:
        positions: (P, J, 3) m, world, NaN = unknown.
        shifts: (P, J, 3) m/s, velocities of the joints.
        seen: `SceneObservations` with D 2D poses.
        mirror: (J,) joint on the other side.
        scale: m, standard deviation of the Gaussian.

    Returns:
        straight, mirrored: (P, D) in 0..1, mean over the joints that both have. `mirrored` compares a 2D
            joint with the projection of the joint on the other side.
        common: (P, D) number of these joints.
    """
    plane, precision, view = seen.plane, seen.precision, seen.views
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
                for j in range(joints):
                    u[j], w[j], z[j] = seen_at(
                        seen.cams, v, positions[p, j], shifts[p, j], seen.cams.delays[v]
                    )
            own = other = 0.0
            count = 0
            for j in range(joints):
                if z[j] <= MIN_DEPTH or precision[d, j] <= 0.0:
                    continue
                count += 1
                x, y, m = plane[d, j, 0], plane[d, j, 1], mirror[j]
                value = _agreement(factor * (((u[j] - x) ** 2 + (w[j] - y) ** 2) * z[j] * z[j]))
                own += value
                if m == j:
                    other += value
                elif z[m] > MIN_DEPTH:
                    other += _agreement(factor * (((u[m] - x) ** 2 + (w[m] - y) ** 2) * z[m] * z[m]))
            if count > 0:
                straight[p, d], mirrored[p, d], common[p, d] = own / count, other / count, count
    return straight, mirrored, common


@njit(cache=True, error_model="numpy")
def _agreement(exponent):
    """Return exp(-exponent), or 0 for a large exponent.

    The cutoff saves time, because most pairs of people are far apart.
    """
    return np.exp(-exponent) if exponent < NOTHING else 0.0


@njit(cache=True, error_model="numpy")
def agreement_of_pairs(chosen, seen, centres, scale):
    """Return the mean agreement of the rays of every two 2D poses, and the number of their common joints.

    The agreement of a joint is exp(-d^2 / (2 scale^2)) with the distance d of its two rays in m. It is 0 if
    the rays are nearly parallel or meet behind a camera.

    Args:
        chosen: (L,) rows of the 2D poses.
        seen: `SceneObservations`.
        centres: (V, 3) m, optical centres of the views, world.
        scale: m, standard deviation of the Gaussian.

    Returns:
        agreements (L, L) in 0..1, and numbers of common joints (L, L); both are 0 for 2D poses of one view.
    """
    plane, precision, view = seen.plane, seen.precision, seen.views
    joints, count = plane.shape[1], len(chosen)
    rays, centre = np.zeros((count, joints, 3)), np.empty(3)
    for i in range(count):
        d = chosen[i]
        for j in range(joints):
            if precision[d, j] > 0.0:
                viewing_ray(seen.cams, view[d], plane[d, j], rays[i, j], centre)
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
