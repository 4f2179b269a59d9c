"""Compiled projection of a target's point into a camera, with its derivatives by all unknowns."""

from __future__ import annotations

import math

from panoptic_ros.kernels import inlined, njit

POSE, LENS = 6, 12  # unknowns of a pose; fx fy cx cy and up to eight terms of distortion of a camera
OFFSET = POSE + LENS  # row of the clock offset of a camera
CAMERA = OFFSET + 1  # unknowns of a camera
FISHEYE_TERMS = 4
NEAREST = 1e-3  # m, least depth of a point in front of the camera
TINY = 1e-12  # radius below which a point is on the axis

_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def project(lens, fisheye, rotation, translation, x, y, z, pixel):
    """Write the pixel (2,) of a world point (x, y, z) m, and return whether it is in front of the camera.

    Args:
        lens: (12,) fx, fy, cx, cy (px), distortion: k1 k2 p1 p2 k3 k4 k5 k6, or k1 k2 k3 k4 of a fisheye.
        fisheye: whether the lens is a fisheye.
        rotation: (3, 3) camera from world.
        translation: (3,) m.
        pixel: (2,) px, output.
    """
    cx = rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z + translation[0]
    cy = rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z + translation[1]
    cz = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z + translation[2]
    if cz < NEAREST:
        return False
    u, v = cx / cz, cy / cz
    radial = _factor(lens, fisheye, u * u + v * v)
    du, dv = _tangential(lens, fisheye, u, v)
    pixel[0] = lens[0] * (u * radial + du) + lens[2]
    pixel[1] = lens[1] * (v * radial + dv) + lens[3]
    return True


@inlined
def _factor(lens, fisheye, r2):
    """Return the radial factor of a lens at a squared radius."""
    if fisheye:
        radius = math.sqrt(r2)
        if radius < TINY:
            return 1.0
        angle = math.atan(radius)
        s = angle * angle
        return angle * (1.0 + s * (lens[4] + s * (lens[5] + s * (lens[6] + s * lens[7])))) / radius
    above = 1.0 + r2 * (lens[4] + r2 * (lens[5] + r2 * lens[8]))
    return above / (1.0 + r2 * (lens[9] + r2 * (lens[10] + r2 * lens[11])))


@inlined
def _tangential(lens, fisheye, u, v):
    """Return the tangential distortion of a point on the plane at 1 m; a fisheye has none."""
    if fisheye:
        return 0.0, 0.0
    p1, p2, r2 = lens[6], lens[7], u * u + v * v
    return 2.0 * p1 * u * v + p2 * (r2 + 2.0 * u * u), p1 * (r2 + 2.0 * v * v) + 2.0 * p2 * u * v


@_jit
def derivatives(lens, fisheye, rotation, translation, x, y, z, pixel, by_camera, by_point):
    """Write the pixel of a world point and its derivatives; return whether it is in front of the camera.

    Args:
        lens, fisheye, rotation, translation, x, y, z, pixel: As in `project`.
        by_camera: (2, 18) output, by the pose (rotation vector from the left, translation), then by `lens`.
        by_point: (2, 3) output, by the world point, px/m.
    """
    px = rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z
    py = rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z
    pz = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z
    depth = pz + translation[2]
    if depth < NEAREST:
        return False
    u, v = (px + translation[0]) / depth, (py + translation[1]) / depth
    r2 = u * u + v * v
    radial = _factor(lens, fisheye, r2)
    du, dv = _tangential(lens, fisheye, u, v)
    bent_u, bent_v = u * radial + du, v * radial + dv
    fx, fy = lens[0], lens[1]
    pixel[0], pixel[1] = fx * bent_u + lens[2], fy * bent_v + lens[3]
    for k in range(POSE, OFFSET):
        by_camera[0, k] = by_camera[1, k] = 0.0
    by_camera[0, POSE], by_camera[1, POSE + 1] = bent_u, bent_v
    by_camera[0, POSE + 2] = by_camera[1, POSE + 3] = 1.0
    terms = POSE + 4
    if fisheye:
        slope = _fisheye_terms(lens, fx, fy, u, v, r2, radial, by_camera)
    else:
        below = 1.0 + r2 * (lens[9] + r2 * (lens[10] + r2 * lens[11]))
        rise = lens[4] + r2 * (2.0 * lens[5] + 3.0 * r2 * lens[8])
        fall = lens[9] + r2 * (2.0 * lens[10] + 3.0 * r2 * lens[11])
        slope = 2.0 * (rise - radial * fall) / below
        power = r2 / below
        for order in range(3):
            above = terms + (4 if order == 2 else order)
            under = terms + 5 + order
            by_camera[0, above], by_camera[1, above] = fx * u * power, fy * v * power
            by_camera[0, under], by_camera[1, under] = -fx * u * radial * power, -fy * v * radial * power
            power *= r2
        by_camera[0, terms + 2], by_camera[1, terms + 2] = fx * 2.0 * u * v, fy * (r2 + 2.0 * v * v)
        by_camera[0, terms + 3], by_camera[1, terms + 3] = fx * (r2 + 2.0 * u * u), fy * 2.0 * u * v
    p1, p2 = (0.0, 0.0) if fisheye else (lens[6], lens[7])
    both = u * v * slope + 2.0 * p1 * u + 2.0 * p2 * v
    uu = fx * (radial + u * u * slope + 2.0 * p1 * v + 6.0 * p2 * u)
    uv, vu = fx * both, fy * both
    vv = fy * (radial + v * v * slope + 6.0 * p1 * v + 2.0 * p2 * u)
    for i in range(2):
        a, b = (uu, uv) if i == 0 else (vu, vv)
        a, b = a / depth, b / depth
        c = -(a * u + b * v)
        by_camera[i, 0], by_camera[i, 1], by_camera[i, 2] = c * py - b * pz, a * pz - c * px, b * px - a * py
        by_camera[i, 3], by_camera[i, 4], by_camera[i, 5] = a, b, c
        for k in range(3):
            by_point[i, k] = a * rotation[0, k] + b * rotation[1, k] + c * rotation[2, k]
    return True


@inlined
def _fisheye_terms(lens, fx, fy, u, v, r2, radial, by_camera):
    """Write the derivatives by the terms of a fisheye, and return twice that of its factor by r2."""
    terms = POSE + 4
    radius = math.sqrt(r2)
    if radius < TINY:
        return 0.0
    angle = math.atan(radius)
    s = angle * angle
    power = angle * s / radius
    for k in range(FISHEYE_TERMS):
        by_camera[0, terms + k], by_camera[1, terms + k] = fx * u * power, fy * v * power
        power *= s
    growth = 1.0 + s * (3.0 * lens[4] + s * (5.0 * lens[5] + s * (7.0 * lens[6] + s * 9.0 * lens[7])))
    return (growth / (1.0 + r2) - radial) / r2
