"""Sums over the segments of a body, and their projection onto its degrees of freedom.

Each segment has a 6 x 6 matrix and a 6-vector, which are sums over its targets. They refer to a rotation of
the segment about the root and to its translation. Sums of children are added to those of their parents, as in
the composite rigid body algorithm (Featherstone, Rigid Body Dynamics Algorithms, 2008, section 6.2). The
Hessian block between segment b and its ancestor a is then X_a^T M_b X_b, where X holds the rotation axes.
"""

from __future__ import annotations

import numpy as np

from panoptic_ros.geometry.segment_chain import Chain
from panoptic_ros.kernels import njit

Array = np.ndarray

_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def add_point(matrix: Array, vector: Array, arm: Array, information: Array, pull: Array) -> None:
    """Add a point target to the sums of its segment: S^T W S and S^T pull, with S = [-[arm] I].

    Args:
        matrix, vector: (6, 6) and (6,), the sums; changed in place.
        arm: (3,) m, from the root to the point.
        information, pull: (3, 3), which is W, and (3,), the gradient of the cost by the point's position.
    """
    x, y, z = arm[0], arm[1], arm[2]
    for j in range(3):
        a = -z * information[1, j] + y * information[2, j]
        b = z * information[0, j] - x * information[2, j]
        c = -y * information[0, j] + x * information[1, j]
        matrix[0, 3 + j] += a
        matrix[1, 3 + j] += b
        matrix[2, 3 + j] += c
        matrix[3 + j, 0] += a
        matrix[3 + j, 1] += b
        matrix[3 + j, 2] += c
        for i in range(3):
            matrix[3 + i, 3 + j] += information[i, j]
        # column j of [arm] W, which is multiplied by [arm]^T below
        if j == 0:
            a0, b0, c0 = a, b, c
        elif j == 1:
            a1, b1, c1 = a, b, c
        else:
            a2, b2, c2 = a, b, c
    matrix[0, 0] += -z * a1 + y * a2
    matrix[0, 1] += z * a0 - x * a2
    matrix[0, 2] += -y * a0 + x * a1
    matrix[1, 0] += -z * b1 + y * b2
    matrix[1, 1] += z * b0 - x * b2
    matrix[1, 2] += -y * b0 + x * b1
    matrix[2, 0] += -z * c1 + y * c2
    matrix[2, 1] += z * c0 - x * c2
    matrix[2, 2] += -y * c0 + x * c1
    vector[0] += -z * pull[1] + y * pull[2]
    vector[1] += z * pull[0] - x * pull[2]
    vector[2] += -y * pull[0] + x * pull[1]
    for i in range(3):
        vector[3 + i] += pull[i]


@_jit
def place_site(frame: Array, place: Array, offset: Array, out: Array) -> None:
    for j in range(3):
        out[j] = place[j] + frame[j, 0] * offset[0] + frame[j, 1] * offset[1] + frame[j, 2] * offset[2]


@_jit
def gather(
    chain: Chain,
    frames: Array,
    places: Array,
    matrices: Array,
    vectors: Array,
    hessian: Array,
    gradient: Array,
) -> None:
    """Project the sums of segments onto the degrees of freedom.

    Args:
        frames, places: (S, 3, 3), world from segment, and (S, 3) m, proximal joints.
        matrices, vectors: (S, 6, 6) and (S, 6) sums. Those of children are added to their parents' in place.
        hessian, gradient: (D, D) and (D,) outputs.
    """
    count = len(chain.parents)
    for s in range(count - 1, 0, -1):
        parent = chain.parents[s]
        for i in range(6):
            vectors[parent, i] += vectors[s, i]
            for j in range(6):
                matrices[parent, i, j] += matrices[s, i, j]
    axes = np.empty((count, 6, 3))
    for s in range(count):
        x, y, z = places[s, 0] - places[0, 0], places[s, 1] - places[0, 1], places[s, 2] - places[0, 2]
        for k in range(3):
            if s == 0:
                a, b, c = 1.0 * (k == 0), 1.0 * (k == 1), 1.0 * (k == 2)
            else:
                parent = chain.parents[s]
                a, b, c = frames[parent, 0, k], frames[parent, 1, k], frames[parent, 2, k]
            axes[s, 0, k], axes[s, 1, k], axes[s, 2, k] = a, b, c
            axes[s, 3, k], axes[s, 4, k], axes[s, 5, k] = y * c - z * b, z * a - x * c, x * b - y * a
    hessian[:] = 0.0
    force = np.empty((6, 3))
    for s in range(count):
        row = 3 + 3 * s
        for k in range(3):
            total = 0.0
            for j in range(6):
                total += axes[s, j, k] * vectors[s, j]
            gradient[row + k] = total
            for i in range(6):
                total = 0.0
                for j in range(6):
                    total += matrices[s, i, j] * axes[s, j, k]
                force[i, k] = total
        above = s
        while above >= 0:
            column = 3 + 3 * above
            for i in range(3):
                for k in range(3):
                    total = 0.0
                    for j in range(6):
                        total += axes[above, j, i] * force[j, k]
                    hessian[column + i, row + k] = total
                    hessian[row + k, column + i] = total
            above = chain.parents[above]
        for i in range(3):
            for k in range(3):
                hessian[i, row + k] = force[3 + i, k]
                hessian[row + k, i] = force[3 + i, k]
    for i in range(3):
        gradient[i] = vectors[0, 3 + i]
        for k in range(3):
            hessian[i, k] = matrices[0, 3 + i, 3 + k]
