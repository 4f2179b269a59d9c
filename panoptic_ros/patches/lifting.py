"""Lifting of image points to the surface of people: capsules round the axes of parts; compiled.

The surface needs to be known to a few centimetres only (see `rigid`). If another part or person is in front
of a point, the point moves with that one, and is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import SkeletonModel
from panoptic_ros.domain.parts import Part
from panoptic_ros.kernels import njit

Array = np.ndarray
IN_FRONT, INSIDE = 0.03, 0.8  # m, least distance of an occluder from a point; share of its radius that counts
HEAD_HALF = 0.01  # m, half length of the axis of a head


class Capsules(NamedTuple):
    """Capsules of K parts.

    Args:
        firsts, lasts: (K, 3) m, ends of the axes; NaN = unknown.
        radii: (K,) m.
    """

    firsts: Array
    lasts: Array
    radii: Array


def axes(parts: tuple[Part, ...], skeleton: SkeletonModel, positions: Array) -> Capsules:
    """Return the capsules of the parts (S) of a person with joints (J, 3) m, NaN = unknown."""
    firsts, lasts = np.full((len(parts), 3), np.nan), np.full((len(parts), 3), np.nan)
    names = [name.lower() for name in skeleton.joint_names]
    for k, part in enumerate(parts):
        if part.is_limb:
            firsts[k], lasts[k] = positions[list(part.joints)]
        elif part.name == "torso":
            for end, word in ((firsts, "shoulder"), (lasts, "hip")):
                end[k] = positions[[j for j, name in enumerate(names) if word in name]].mean(axis=0)
        else:
            known = positions[list(part.joints)]
            known = known[np.isfinite(known[:, 0])]
            if len(known):
                firsts[k], lasts[k] = known.mean(axis=0) + np.array([[0, 0, HEAD_HALF], [0, 0, -HEAD_HALF]])
    return Capsules(firsts, lasts, np.array([part.radius for part in parts]))


def joined(bodies: Sequence[Capsules]) -> Capsules:
    """Return the capsules of all people."""
    nothing = Capsules(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
    return Capsules(*(np.concatenate(rows) for rows in zip(nothing, *bodies)))


@njit(cache=True, error_model="numpy", nogil=True)
def lift(origin, rays, own, capsules, points, normals, seen):
    """Intersect rays (N, 3) from a camera at `origin` (3,) m with their own capsules.

    A ray that misses its capsule gets its closest point to the capsule's axis.

    Args:
        own: (N,) index into the capsules.
        points: (N, 3) m, output, positions on the surface.
        normals: (N, 3), output, unit normals out of the capsule.
        seen: (N,) output, whether the position is known and nothing else is in front.
    """
    nearest, foot = np.empty(3), np.empty(3)
    for n in range(len(rays)):
        depth, distance = _pass(origin, rays[n], capsules, own[n], nearest, foot)
        seen[n] = np.isfinite(depth)
        if not seen[n]:
            continue
        radius = capsules.radii[own[n]]
        depth -= np.sqrt(max(radius * radius - distance * distance, 0.0))
        length = 0.0
        for i in range(3):
            points[n, i] = origin[i] + depth * rays[n, i]
            normals[n, i] = points[n, i] - foot[i]
            length += normals[n, i] ** 2
        for i in range(3):
            normals[n, i] /= max(np.sqrt(length), 1e-9)
        for k in range(len(capsules.radii)):
            if k != own[n]:
                other, aside = _pass(origin, rays[n], capsules, k, nearest, foot)
                front = other - np.sqrt(max(capsules.radii[k] ** 2 - aside * aside, 0.0))
                if aside < INSIDE * capsules.radii[k] and 0.0 < front < depth - IN_FRONT:
                    seen[n] = False
                    break


@njit(cache=True, error_model="numpy", nogil=True)
def nearest_parts(points, rows, firsts, lasts, radii, nearest):
    """Find the part of each point's person whose surface is nearest to the point.

    Args:
        points: (N, 3) m.
        rows: (N,) person of each point.
        firsts, lasts: (P, K, 3) m, ends of the axes of K parts of P people, NaN = unknown.
        radii: (K,) m.
        nearest: (N,) output, index of the part; -1: no part is known.
    """
    for n in range(len(points)):
        nearest[n], least = -1, np.inf
        for k in range(len(radii)):
            first, last = firsts[rows[n], k], lasts[rows[n], k]
            along = square = distance = 0.0
            for i in range(3):
                along += (last[i] - first[i]) * (points[n, i] - first[i])
                square += (last[i] - first[i]) ** 2
            share = min(1.0, max(0.0, along / max(square, 1e-9)))
            for i in range(3):
                distance += (points[n, i] - first[i] - share * (last[i] - first[i])) ** 2
            above = np.sqrt(distance) - radii[k]
            if above < least:
                nearest[n], least = k, above


@njit(cache=True, error_model="numpy", nogil=True)
def _pass(origin, ray, capsules, k, nearest, foot):
    """Return depth m along a ray and distance m from a capsule's axis, where ray and axis are closest.

    Both are NaN if the axis is unknown or behind the origin.

    Args:
        nearest, foot: (3,) outputs, the closest points on the ray and on the axis.
    """
    first, last = capsules.firsts[k], capsules.lasts[k]
    square = along = aside = across = 0.0
    for i in range(3):
        axis, offset = last[i] - first[i], origin[i] - first[i]
        square += axis * axis
        along += ray[i] * axis
        aside += ray[i] * offset
        across += axis * offset
    share = (across - along * aside) / max(square - along * along, 1e-9)
    share = min(1.0, max(0.0, share))
    depth, distance = 0.0, 0.0
    for i in range(3):
        foot[i] = first[i] + share * (last[i] - first[i])
        depth += (foot[i] - origin[i]) * ray[i]
    for i in range(3):
        nearest[i] = origin[i] + depth * ray[i]
        distance += (nearest[i] - foot[i]) ** 2
    if not depth > 0.0:
        return np.nan, np.nan
    return depth, np.sqrt(distance)
