"""Compiled kernels on the viewing rays of 2D peaks."""
from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.solving.lens_kernels import straighten_fisheye

_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def pixel_rays(cameras, views, pixels):
    """Unit viewing rays (K, 3) in the world of pixels (K, 2) of the views (K,); NaN if there is none.

    `cameras` as in `VoteScene`.
    """
    rays = np.full((len(pixels), 3), np.nan)
    for n in range(len(pixels)):
        camera = cameras[views[n]]
        goal_y = (pixels[n, 1] - camera.cy) / camera.fy
        goal_x = (pixels[n, 0] - camera.cx - camera.skew * goal_y) / camera.fx
        x, y, found = _undistorted(camera, goal_x, goal_y)
        if found:
            length = np.sqrt(x * x + y * y + 1.0)
            rays[n, 0] = (camera.r00 * x + camera.r10 * y + camera.r20) / length
            rays[n, 1] = (camera.r01 * x + camera.r11 * y + camera.r21) / length
            rays[n, 2] = (camera.r02 * x + camera.r12 * y + camera.r22) / length
    return rays


@_jit
def _undistorted(camera, goal_x, goal_y):
    """The undistorted point of a distorted one, by Newton's method, and whether it was found."""
    k1, k2, p1, p2, k3, fold = camera.k1, camera.k2, camera.p1, camera.p2, camera.k3, camera.fold
    if camera.fisheye > 0.0:
        reached = np.sqrt(goal_x * goal_x + goal_y * goal_y)
        scale, found = straighten_fisheye(k1, k2, k3, camera.k4, np.sqrt(fold), reached)
        return scale * goal_x, scale * goal_y, found
    x, y = goal_x, goal_y
    for _ in range(20):
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        miss_x = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) - goal_x
        miss_y = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y - goal_y
        if abs(miss_x) + abs(miss_y) < 1e-12:
            return x, y, r2 < fold
        slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3))
        cross = x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
        dx = radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
        dy = radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
        det = dx * dy - cross * cross
        if abs(det) < 1e-9:
            return x, y, False
        x -= (dy * miss_x - cross * miss_y) / det
        y -= (dx * miss_y - cross * miss_x) / det
    return x, y, False


@_jit
def pair_seeds(centres, rays, views, start, paired, gap, max_depth, enough):
    """Points where rays of a joint meet: pairs of rays, improved with the rays of the other views.

    A pair of rays of two `paired` views (V,) that pass within `gap` gives its middle; that moves twice
    to the point closest to the rays that pass nearest to it in each view, within gap and half of it, and
    counts if it still has `enough` such rays. These are not paired with each other again.

    Args:
        rays: (K, 3), those of joint j from start[j] to start[j + 1], in the order of their views (K,).

    Returns:
        joints (S,), seeds (S, 3).
    """
    joints, seeds = np.zeros(0, np.int64), np.zeros((0, 3))
    for joint in range(len(start) - 1):
        mine = slice(start[joint], start[joint + 1])
        found = _seeds_of_joint(centres, rays[mine], views[mine], paired, gap, max_depth, enough)
        joints = np.concatenate((joints, np.full(len(found), joint)))
        seeds = np.concatenate((seeds, found))
    return joints, seeds


@_jit
def _seeds_of_joint(centres, rays, views, paired, gap, max_depth, enough):
    """Seeds (S, 3) from the rays of one joint."""
    mine, some = np.empty(len(rays), np.int64), 0
    row = np.empty(len(rays), np.int64)  # of the table of pairs; those that are not paired share the last
    for k in range(len(rays)):
        row[k] = -1
        if paired[views[k]]:
            mine[some], row[k] = k, some
            some += 1
    mine = mine[:some]
    together = np.zeros((len(mine) + 1, len(mine) + 1), np.bool_)
    seeds, total = np.empty((len(mine) * (len(mine) - 1) // 2, 3)), 0
    nearest = np.empty(len(centres), np.int64)
    for a in range(len(mine)):
        for b in range(a + 1, len(mine)):
            p, q = mine[a], mine[b]
            if views[p] == views[q] or together[a, b]:
                continue
            point, met = _meeting(centres, rays, views, p, q, gap, max_depth)
            if not met:
                continue
            point, count = _closest_to_rays(centres, rays, views, point, gap, nearest)
            if count < enough:
                continue
            point, count = _closest_to_rays(centres, rays, views, point, 0.5 * gap, nearest)
            if count < enough:
                continue
            seeds[total, 0], seeds[total, 1], seeds[total, 2] = point
            total += 1
            for k in range(count):
                for m in range(k + 1, count):
                    together[row[nearest[k]], row[nearest[m]]] = True
    return seeds[:total].copy()


@_jit
def _meeting(centres, rays, views, p, q, gap, max_depth):
    """The middle of where two rays come closest, and whether they do so within the limits."""
    ax, ay, az, bx, by, bz = rays[p, 0], rays[p, 1], rays[p, 2], rays[q, 0], rays[q, 1], rays[q, 2]
    v, w = views[p], views[q]
    ox, oy, oz = centres[w, 0] - centres[v, 0], centres[w, 1] - centres[v, 1], centres[w, 2] - centres[v, 2]
    ab = ax * bx + ay * by + az * bz
    ao, bo = ax * ox + ay * oy + az * oz, bx * ox + by * oy + bz * oz
    sine2 = 1.0 - ab * ab
    a, b = (ao - ab * bo) / sine2, (ab * ao - bo) / sine2  # depths
    if not (sine2 > 1e-6 and 0.0 < a < max_depth and 0.0 < b < max_depth):  # also for NaN
        return (0.0, 0.0, 0.0), False
    dx, dy, dz = ox + b * bx - a * ax, oy + b * by - a * ay, oz + b * bz - a * az
    middle = (
        centres[v, 0] + a * ax + 0.5 * dx,
        centres[v, 1] + a * ay + 0.5 * dy,
        centres[v, 2] + a * az + 0.5 * dz,
    )
    return middle, dx * dx + dy * dy + dz * dz <= gap * gap


@_jit
def _closest_to_rays(centres, rays, views, point, gate, nearest):
    """The point closest to the nearest ray of each view within the gate, and the number of these views.

    Writes which rays these are to `nearest`.
    """
    x, y, z = point
    xx, xy, xz, yy, yz, zz, rx, ry, rz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    count, k = 0, 0
    while k < len(rays):
        v, best, found = views[k], gate * gate, False
        ox, oy, oz = x - centres[v, 0], y - centres[v, 1], z - centres[v, 2]
        square = ox * ox + oy * oy + oz * oz
        while k < len(rays) and views[k] == v:
            along = rays[k, 0] * ox + rays[k, 1] * oy + rays[k, 2] * oz
            aside = square - along * along
            if along > 0.0 and aside <= best:
                nearest[count], best, found = k, aside, True
            k += 1
        if not found:
            continue
        dx, dy, dz = rays[nearest[count]]
        count += 1
        along = dx * ox + dy * oy + dz * oz
        xx += 1.0 - dx * dx
        yy += 1.0 - dy * dy
        zz += 1.0 - dz * dz
        xy -= dx * dy
        xz -= dx * dz
        yz -= dy * dz
        rx += ox - along * dx
        ry += oy - along * dy
        rz += oz - along * dz
    cx, cy, cz = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    det = xx * cx + xy * cy + xz * cz
    if count < 2 or det < 1e-9:
        return point, count
    step_x = (cx * rx + cy * ry + cz * rz) / det
    step_y = (cy * rx + (xx * zz - xz * xz) * ry + (xy * xz - xx * yz) * rz) / det
    step_z = (cz * rx + (xy * xz - xx * yz) * ry + (xx * yy - xy * xy) * rz) / det
    return (x - step_x, y - step_y, z - step_z), count
