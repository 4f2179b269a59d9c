"""Compiled kernels on the viewing rays of 2D peaks. They call nothing outside of this file.

Peaks are in the order of view and joint: those of (v, j) are start[v * J + j] .. start[v * J + j + 1].
"""
from __future__ import annotations

import numpy as np
from numba import njit

_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def pixel_rays(cameras, views, pixels):
    """Unit viewing rays (K, 3) in the world of pixels (K, 2) of the views (K,); NaN if there is none.

    `cameras` as in `VoteScene`.
    """
    rays = np.full((len(pixels), 3), np.nan)
    for n in range(len(pixels)):
        camera = cameras[views[n]]
        goal_y = (pixels[n, 1] - camera[16]) / camera[15]
        goal_x = (pixels[n, 0] - camera[14] - camera[13] * goal_y) / camera[12]
        x, y, found = _undistorted(camera[17:23], goal_x, goal_y)
        if found:
            length = np.sqrt(x * x + y * y + 1.0)
            for axis in range(3):
                rays[n, axis] = (camera[axis] * x + camera[3 + axis] * y + camera[6 + axis]) / length
    return rays


@_jit
def _undistorted(lens, goal_x, goal_y):
    """The undistorted point of a distorted one, by Newton's method, and whether it was found."""
    k1, k2, p1, p2, k3, fold = lens
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
def pair_seeds(centres, rays, start, paired, joint_count, gap, max_depth, enough, joints, seeds):
    """Points where rays of a joint meet: every pair of rays, improved with the rays of the other views.

    A pair of rays of two `paired` views (V,) that pass within `gap` gives its middle; that moves twice
    to the point closest to the rays that pass nearest to it in each view, within gap and half of it, and
    counts if it still has `enough` such rays. Writes as many as fit into joints (S,) and seeds (S, 3);
    returns the number.
    """
    total = 0
    for joint in range(joint_count):
        for a in range(len(centres)):
            if not paired[a]:
                continue
            for p in range(start[a * joint_count + joint], start[a * joint_count + joint + 1]):
                for b in range(a + 1, len(centres)):
                    if not paired[b]:
                        continue
                    for q in range(start[b * joint_count + joint], start[b * joint_count + joint + 1]):
                        point, met = _meeting(centres[a], rays[p], centres[b], rays[q], gap, max_depth)
                        if not met:
                            continue
                        point, views = _closest_to_rays(centres, rays, start, joint, joint_count, point, gap)
                        if views < enough:
                            continue
                        point, views = _closest_to_rays(
                            centres, rays, start, joint, joint_count, point, 0.5 * gap
                        )
                        if views >= enough:
                            if total < len(seeds):
                                joints[total] = joint
                                seeds[total, 0], seeds[total, 1], seeds[total, 2] = point
                            total += 1
    return total


@_jit
def _meeting(centre_a, ray_a, centre_b, ray_b, gap, max_depth):
    """The middle of where two rays come closest, and whether they do so within the limits."""
    ox, oy, oz = centre_b[0] - centre_a[0], centre_b[1] - centre_a[1], centre_b[2] - centre_a[2]
    ab = ray_a[0] * ray_b[0] + ray_a[1] * ray_b[1] + ray_a[2] * ray_b[2]
    ao = ray_a[0] * ox + ray_a[1] * oy + ray_a[2] * oz
    bo = ray_b[0] * ox + ray_b[1] * oy + ray_b[2] * oz
    sine2 = 1.0 - ab * ab
    a, b = (ao - ab * bo) / sine2, (ab * ao - bo) / sine2  # depths
    if not (sine2 > 1e-6 and 0.0 < a < max_depth and 0.0 < b < max_depth):  # also for NaN
        return (0.0, 0.0, 0.0), False
    dx = ox + b * ray_b[0] - a * ray_a[0]
    dy = oy + b * ray_b[1] - a * ray_a[1]
    dz = oz + b * ray_b[2] - a * ray_a[2]
    middle = (
        centre_a[0] + a * ray_a[0] + 0.5 * dx,
        centre_a[1] + a * ray_a[1] + 0.5 * dy,
        centre_a[2] + a * ray_a[2] + 0.5 * dz,
    )
    return middle, dx * dx + dy * dy + dz * dz <= gap * gap


@_jit
def _closest_to_rays(centres, rays, start, joint, joints, point, gate):
    """The point closest to the nearest ray of each view within the gate, and the number of views."""
    x, y, z = point
    xx, xy, xz, yy, yz, zz, rx, ry, rz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    views = 0
    for v in range(len(centres)):
        ox, oy, oz = x - centres[v, 0], y - centres[v, 1], z - centres[v, 2]
        square = ox * ox + oy * oy + oz * oz
        nearest, best = -1, gate * gate
        for k in range(start[v * joints + joint], start[v * joints + joint + 1]):
            along = rays[k, 0] * ox + rays[k, 1] * oy + rays[k, 2] * oz
            aside = square - along * along
            if along > 0.0 and aside <= best:
                nearest, best = k, aside
        if nearest < 0:
            continue
        views += 1
        dx, dy, dz = rays[nearest]
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
    if views < 2 or det < 1e-9:
        return point, views
    step_x = (cx * rx + cy * ry + cz * rz) / det
    step_y = (cy * rx + (xx * zz - xz * xz) * ry + (xy * xz - xx * yz) * rz) / det
    step_z = (cz * rx + (xy * xz - xx * yz) * ry + (xx * yy - xy * xy) * rz) / det
    return (x - step_x, y - step_y, z - step_z), views
