"""Compiled kernels on the viewing rays of 2D peaks."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import inlined, njit
from panoptic_ros.solving.evidence import undistort_points

Array = np.ndarray

_jit = njit(cache=True, error_model="numpy", nogil=True)


class Meeting(NamedTuple):
    """What rays that meet satisfy.

    gap: m, largest distance between two rays. max_depth: m, from a camera. enough: views, two or more.
    paired: (V,) bool, views whose rays are paired.
    """

    gap: float
    max_depth: float
    enough: int
    paired: Array


class _Rays(NamedTuple):
    """Rays of one joint, in the order of their views (K,): directions (K, 3); centres (V, 3) of the views."""

    views: Array
    directions: Array
    centres: Array


@_jit
def pixel_rays(cameras, views, pixels):
    """Unit viewing rays (K, 3) in the world of pixels (K, 2) of the views (K,); NaN if there is none.

    `cameras` as in `VoteScene`.
    """
    rays = np.full((len(pixels), 3), np.nan)
    usable = np.ones((len(pixels), 1), np.bool_)
    plane, _, found = undistort_points(pixels.reshape((-1, 1, 2)), usable, views, cameras)
    for n in range(len(pixels)):
        camera, x, y = cameras[views[n]], plane[n, 0, 0], plane[n, 0, 1]
        if found[n, 0] and x * x + y * y < camera.fold:
            length = np.sqrt(x * x + y * y + 1.0)
            rays[n, 0] = (camera.r00 * x + camera.r10 * y + camera.r20) / length
            rays[n, 1] = (camera.r01 * x + camera.r11 * y + camera.r21) / length
            rays[n, 2] = (camera.r02 * x + camera.r12 * y + camera.r22) / length
    return rays


@_jit
def pair_seeds(scene, peaks, meeting):
    """Points where rays of a joint meet: pairs of rays, improved with the rays of the other views.

    A pair of rays of two paired views that pass within the gap gives its middle; that moves twice to the
    point closest to the rays that pass nearest to it in each view, within the gap and half of it, and counts
    if it still has enough such rays. These are not paired with each other again.

    Args:
        scene: `VoteScene`; peaks: `ImagePeaks`; meeting: `Meeting`.

    Returns:
        joints (S,), seeds (S, 3).
    """
    start, pixels = peaks
    count, joint_count = len(scene.cameras), scene.map_start.shape[1]
    centres, views = np.empty((count, 3)), np.empty(len(pixels), np.int64)
    for v in range(count):
        camera = scene.cameras[v]
        centres[v, 0], centres[v, 1], centres[v, 2] = camera.ox, camera.oy, camera.oz
        views[start[v * joint_count] : start[(v + 1) * joint_count]] = v
    rays = pixel_rays(scene.cameras, views, pixels)
    joints, seeds = np.zeros(0, np.int64), np.zeros((0, 3))
    for joint in range(joint_count):
        mine = np.zeros(len(pixels), np.bool_)
        for v in range(count):
            key = v * joint_count + joint
            mine[start[key] : start[key + 1]] = True
        found = _seeds_of_joint(_Rays(views[mine], rays[mine], centres), meeting)
        joints = np.concatenate((joints, np.full(len(found), joint)))
        seeds = np.concatenate((seeds, found))
    return joints, seeds


@_jit
def _seeds_of_joint(rays, meeting):
    """Seeds (S, 3) from the rays of one joint."""
    views, centres = rays.views, rays.centres
    mine, some = np.empty(len(views), np.int64), 0
    row = np.empty(len(views), np.int64)  # of the table of pairs; those that are not paired share the last
    for k in range(len(views)):
        row[k] = -1
        if meeting.paired[views[k]]:
            mine[some], row[k] = k, some
            some += 1
    together = np.zeros((some + 1, some + 1), np.bool_)
    seeds, total = np.empty((some * (some - 1) // 2, 3)), 0
    nearest = np.empty(len(centres), np.int64)
    for a in range(some):
        for b in range(a + 1, some):
            p, q = mine[a], mine[b]
            if views[p] == views[q] or together[a, b]:
                continue
            point, met = _meeting(rays, p, q, meeting)
            if not met:
                continue
            point, count = _closest_to_rays(rays, point, meeting.gap, nearest)
            if count < meeting.enough:
                continue
            point, count = _closest_to_rays(rays, point, 0.5 * meeting.gap, nearest)
            if count < meeting.enough:
                continue
            seeds[total, 0], seeds[total, 1], seeds[total, 2] = point
            total += 1
            for k in range(count):
                for m in range(k + 1, count):
                    together[row[nearest[k]], row[nearest[m]]] = True
    return seeds[:total].copy()


@inlined
def _meeting(rays, p, q, meeting):
    """The middle of where rays p and q come closest, and whether they do so within the limits."""
    ax, ay, az = rays.directions[p, 0], rays.directions[p, 1], rays.directions[p, 2]
    bx, by, bz = rays.directions[q, 0], rays.directions[q, 1], rays.directions[q, 2]
    v, w, centres = rays.views[p], rays.views[q], rays.centres
    ox, oy, oz = centres[w, 0] - centres[v, 0], centres[w, 1] - centres[v, 1], centres[w, 2] - centres[v, 2]
    ab = ax * bx + ay * by + az * bz
    ao, bo = ax * ox + ay * oy + az * oz, bx * ox + by * oy + bz * oz
    sine2 = 1.0 - ab * ab
    a, b = (ao - ab * bo) / sine2, (ab * ao - bo) / sine2  # depths
    near = sine2 > 1e-6 and 0.0 < a < meeting.max_depth and 0.0 < b < meeting.max_depth  # not if NaN
    dx, dy, dz = ox + b * bx - a * ax, oy + b * by - a * ay, oz + b * bz - a * az
    middle = (
        centres[v, 0] + a * ax + 0.5 * dx,
        centres[v, 1] + a * ay + 0.5 * dy,
        centres[v, 2] + a * az + 0.5 * dz,
    )
    return middle, near and dx * dx + dy * dy + dz * dz <= meeting.gap * meeting.gap


@inlined
def _closest_to_rays(rays, point, gate, nearest):
    """The point closest to the nearest ray of each view within the gate, and the number of these views.

    Writes which rays these are to `nearest`.
    """
    views, directions, centres = rays.views, rays.directions, rays.centres
    x, y, z = point
    xx, xy, xz, yy, yz, zz, rx, ry, rz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    count, k = 0, 0
    while k < len(views):
        v, best, found = views[k], gate * gate, False
        ox, oy, oz = x - centres[v, 0], y - centres[v, 1], z - centres[v, 2]
        square = ox * ox + oy * oy + oz * oz
        while k < len(views) and views[k] == v:
            along = directions[k, 0] * ox + directions[k, 1] * oy + directions[k, 2] * oz
            aside = square - along * along
            if along > 0.0 and aside <= best:
                nearest[count], best, found = k, aside, True
            k += 1
        if not found:
            continue
        n = nearest[count]
        count += 1
        dx, dy, dz = directions[n, 0], directions[n, 1], directions[n, 2]
        along = dx * ox + dy * oy + dz * oz
        xx, yy, zz = xx + (1.0 - dx * dx), yy + (1.0 - dy * dy), zz + (1.0 - dz * dz)
        xy, xz, yz = xy - dx * dy, xz - dx * dz, yz - dy * dz
        rx, ry, rz = rx + (ox - along * dx), ry + (oy - along * dy), rz + (oz - along * dz)
    cx, cy, cz = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    det = xx * cx + xy * cy + xz * cz
    if count < 2 or det < 1e-9:
        return point, count
    step_x = (cx * rx + cy * ry + cz * rz) / det
    step_y = (cy * rx + (xx * zz - xz * xz) * ry + (xy * xz - xx * yz) * rz) / det
    step_z = (cz * rx + (xy * xz - xx * yz) * ry + (xx * yy - xy * xy) * rz) / det
    return (x - step_x, y - step_y, z - step_z), count
