"""Linear triangulation of the joints of a person from the 2D people of several views."""
from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.solving.gauss_newton import solve_symmetric


@njit(cache=True, error_model="numpy", nogil=True)
def middle_of_cameras(member, rotations, translations):
    """Mean (3,) m of the centres of the cameras that have a 2D person in member (V,); 0 if none has."""
    middle, count = np.zeros(3), 0
    for v in range(len(member)):
        if member[v] >= 0:
            count += 1
            for i in range(3):
                for k in range(3):
                    middle[i] -= rotations[v, k, i] * translations[v, k]
    return middle / max(count, 1)


@njit(cache=True, error_model="numpy")
def triangulate_linear(member, mirrored, seen, mirror):
    """Linear triangulation (J, 3) m of the 2D people member (V,), NaN with fewer than two views.

    It is solved relative to the mean centre of their cameras. Damping then pulls towards that centre,
    wherever the world has its origin.
    """
    plane, precision, joints = seen.plane, seen.precision, len(mirror)
    rotations, translations, _ = seen.cams
    points = np.full((joints, 3), np.nan)
    row, middle = np.empty(3), middle_of_cameras(member, rotations, translations)
    moved = np.empty((len(member), 3))
    for v in range(len(member)):
        for i in range(3):
            moved[v, i] = translations[v, i]
            for k in range(3):
                moved[v, i] += rotations[v, i, k] * middle[k]
    for j in range(joints):
        normal, right = np.zeros((3, 3)), np.zeros(3)
        count = 0
        for v in range(len(member)):
            d = member[v]
            if d < 0:
                continue
            s = mirror[j] if mirrored[v] else j
            weight = precision[d, s]
            if weight <= 0.0:
                continue
            count += 1
            for k in range(2):
                for i in range(3):
                    row[i] = weight * (plane[d, s, k] * rotations[v, 2, i] - rotations[v, k, i])
                offset = weight * (moved[v, k] - plane[d, s, k] * moved[v, 2])
                for i in range(3):
                    right[i] += row[i] * offset
                    for m in range(i + 1):
                        normal[i, m] += row[i] * row[m]
        if count < 2:
            continue
        damping = 1e-9 * max(normal[0, 0] + normal[1, 1] + normal[2, 2], 1e-9)
        lower = (
            normal[0, 0] + damping, normal[1, 0], normal[1, 1] + damping, normal[2, 0], normal[2, 1],
            normal[2, 2] + damping,
        )  # fmt: skip
        good, a, b, c = solve_symmetric(lower, (right[0], right[1], right[2]))
        if good:
            points[j, 0], points[j, 1], points[j, 2] = a + middle[0], b + middle[1], c + middle[2]
    return points
