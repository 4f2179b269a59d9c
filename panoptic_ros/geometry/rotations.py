"""Rotations: exponential, logarithm and its derivative, quaternions w x y z."""

from __future__ import annotations

import math

import numpy as np

from panoptic_ros.kernels import njit

Array = np.ndarray
TINY = 1e-8
NEAR_PI = 3.1  # rad, angle from which the logarithm uses the symmetric part

_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def rotation_of(vector: Array, out: Array) -> None:
    """Write the rotation (3, 3) of a rotation vector (3,) rad to `out`, by Rodrigues' formula."""
    x, y, z = vector[0], vector[1], vector[2]
    angle2 = x * x + y * y + z * z
    if angle2 < TINY:
        s, c = 1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0
    else:
        angle = math.sqrt(angle2)
        s, c = math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle2
    out[0, 0], out[0, 1], out[0, 2] = 1.0 - c * (y * y + z * z), -s * z + c * x * y, s * y + c * x * z
    out[1, 0], out[1, 1], out[1, 2] = s * z + c * x * y, 1.0 - c * (x * x + z * z), -s * x + c * y * z
    out[2, 0], out[2, 1], out[2, 2] = -s * y + c * x * z, s * x + c * y * z, 1.0 - c * (x * x + y * y)


@_jit
def vector_of(rotation: Array, out: Array) -> None:
    """Write the rotation vector (3,) rad of a rotation (3, 3), at most pi long, to `out`."""
    cosine = 0.5 * (rotation[0, 0] + rotation[1, 1] + rotation[2, 2] - 1.0)
    angle = math.acos(max(-1.0, min(1.0, cosine)))
    out[0] = 0.5 * (rotation[2, 1] - rotation[1, 2])
    out[1] = 0.5 * (rotation[0, 2] - rotation[2, 0])
    out[2] = 0.5 * (rotation[1, 0] - rotation[0, 1])
    if angle < 1e-6:
        return
    if angle < NEAR_PI:
        scale = angle / math.sin(angle)
        for i in range(3):
            out[i] *= scale
        return
    k = 0
    for i in range(1, 3):
        if rotation[i, i] > rotation[k, k]:
            k = i
    x = 0.5 * (rotation[0, k] + rotation[k, 0]) + (1.0 if k == 0 else 0.0)
    y = 0.5 * (rotation[1, k] + rotation[k, 1]) + (1.0 if k == 1 else 0.0)
    z = 0.5 * (rotation[2, k] + rotation[k, 2]) + (1.0 if k == 2 else 0.0)
    # the symmetric part is cos I + (1 - cos) n n^T: subtract cos from its diagonal; 1 was added above
    if k == 0:
        x -= 1.0 + cosine
    elif k == 1:
        y -= 1.0 + cosine
    else:
        z -= 1.0 + cosine
    length = math.sqrt(x * x + y * y + z * z)
    if out[0] * x + out[1] * y + out[2] * z < 0.0:
        length = -length
    out[0], out[1], out[2] = angle * x / length, angle * y / length, angle * z / length


@_jit
def inverse_left_jacobian(vector: Array, out: Array) -> None:
    """Write d log(exp(u) R) / d u (3, 3) at u = 0 to `out`, for R of this rotation vector (3,) rad."""
    x, y, z = vector[0], vector[1], vector[2]
    angle2 = x * x + y * y + z * z
    if angle2 < 1e-6:
        c = 1.0 / 12.0 + angle2 / 720.0
    else:
        angle = math.sqrt(angle2)
        c = 1.0 / angle2 - (1.0 + math.cos(angle)) / (2.0 * angle * math.sin(angle))
    out[0, 0], out[0, 1], out[0, 2] = 1.0 - c * (y * y + z * z), 0.5 * z + c * x * y, -0.5 * y + c * x * z
    out[1, 0], out[1, 1], out[1, 2] = -0.5 * z + c * x * y, 1.0 - c * (x * x + z * z), 0.5 * x + c * y * z
    out[2, 0], out[2, 1], out[2, 2] = 0.5 * y + c * x * z, -0.5 * x + c * y * z, 1.0 - c * (x * x + y * y)


@_jit
def rotations_of(vectors: Array) -> Array:
    """Return the rotations (N, 3, 3) of rotation vectors (N, 3) rad."""
    out = np.empty((len(vectors), 3, 3))
    for k in range(len(vectors)):
        rotation_of(vectors[k], out[k])
    return out


@_jit
def vectors_of(rotations: Array) -> Array:
    """Return the rotation vectors (N, 3) rad of rotations (N, 3, 3)."""
    out = np.empty((len(rotations), 3))
    for k in range(len(rotations)):
        vector_of(rotations[k], out[k])
    return out


@_jit
def _from_quaternions(quaternions: Array) -> Array:
    """Return the rotations (N, 3, 3) of quaternions (N, 4) w x y z of any length."""
    out = np.empty((len(quaternions), 3, 3))
    for k in range(len(quaternions)):
        w, x, y, z = quaternions[k]
        length = math.sqrt(w * w + x * x + y * y + z * z)
        w, x, y, z = w / length, x / length, y / length, z / length
        r = out[k]
        r[0, 0], r[0, 1], r[0, 2] = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
        r[1, 0], r[1, 1], r[1, 2] = 2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)
        r[2, 0], r[2, 1], r[2, 2] = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
    return out


def from_quaternions(quaternions: Array) -> Array:
    """Return the rotations (..., 3, 3) of quaternions (..., 4) w x y z, which need not have length 1."""
    given = np.array(quaternions, np.float64, order="C")  # kernels need contiguous float64 arrays
    found: Array = _from_quaternions(given.reshape(-1, 4)).reshape(*given.shape[:-1], 3, 3)
    return found


@_jit
def _to_quaternions(rotations: Array) -> Array:
    """Return the quaternions (N, 4) w x y z, with w >= 0, of rotations (N, 3, 3)."""
    out = np.empty((len(rotations), 4))
    squares = np.empty(4)  # four times the squared components
    for n in range(len(rotations)):
        r, q = rotations[n], out[n]
        squares[0] = 1.0 + r[0, 0] + r[1, 1] + r[2, 2]
        squares[1] = 1.0 + r[0, 0] - r[1, 1] - r[2, 2]
        squares[2] = 1.0 - r[0, 0] + r[1, 1] - r[2, 2]
        squares[3] = 1.0 - r[0, 0] - r[1, 1] + r[2, 2]
        k = 0
        for i in range(1, 4):
            if squares[i] > squares[k]:
                k = i
        wx, wy, wz = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
        xy, xz, yz = r[1, 0] + r[0, 1], r[2, 0] + r[0, 2], r[2, 1] + r[1, 2]
        if k == 0:
            q[0], q[1], q[2], q[3] = squares[0], wx, wy, wz
        elif k == 1:
            q[0], q[1], q[2], q[3] = wx, squares[1], xy, xz
        elif k == 2:
            q[0], q[1], q[2], q[3] = wy, xy, squares[2], yz
        else:
            q[0], q[1], q[2], q[3] = wz, xz, yz, squares[3]
        length = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
        if q[0] < 0.0:
            length = -length
        for i in range(4):
            q[i] /= length
    return out


def to_quaternions(rotations: Array) -> Array:
    """Return the quaternions (..., 4) w x y z, with w >= 0, of rotations (..., 3, 3).

    There are four formulas for a quaternion. The function uses the one with the largest divisor (Shepperd
    1978), which is accurate near half turns too.
    """
    given = np.array(rotations, np.float64, order="C")
    found: Array = _to_quaternions(given.reshape(-1, 3, 3)).reshape(*given.shape[:-2], 4)
    return found


def turn_about_z(angle: float) -> Array:
    """Return the rotation (3, 3) by an angle, rad, about the vertical (z)."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def mean_rotation(rotations: Array) -> Array:
    """Return the rotation (..., 3, 3) nearest to the arithmetic mean of rotations (N, ..., 3, 3)."""
    u, _, v = np.linalg.svd(rotations.mean(0))
    u[..., 2] *= np.linalg.det(u @ v)[..., None]
    mean: Array = u @ v
    return mean
