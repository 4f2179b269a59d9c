"""Sparse search: nodes where viewing rays of 2D peaks meet."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.domain.of_all import selected
from panoptic_ros.geometry.lens_kernels import undistort_points
from panoptic_ros.kernels import inlined, njit
from panoptic_ros.solving.triangulation import spread_views
from panoptic_ros.voting.peaks import KnownNodes, find_peaks
from panoptic_ros.voting.proposals import NodeCriteria, NodeProposals, distinct, no_nodes
from panoptic_ros.voting.scene import VoteScene
from panoptic_ros.voting.soft_vote import moved
from panoptic_ros.voting.votes import at_rest, vote_points

Array = np.ndarray
GAP = 0.15  # m, largest distance between two rays that may be of one joint
MAX_DEPTH = 25.0  # m, greatest depth of a seed from a camera
PAIRED_VIEWS = 10  # greatest number of paired views; of more views, those spread over the rig are used
SPACING = 0.12  # m, least distance between two seeds of a joint that are followed
PROMISE = 0.9  # least vote of a seed that is followed, relative to the threshold of a node


class _Rays(NamedTuple):
    """Rays of one joint, in the order of their views.

    Args:
        views: (K,) view of each ray.
        directions: (K, 3) unit vectors.
        centres: (V, 3) m, optical centres of the views.
    """

    views: Array
    directions: Array
    centres: Array


def nodes_at_seeds(scene: VoteScene, wanted: NodeCriteria, known: KnownNodes) -> NodeProposals:
    """Return nodes at seeds, each moved to the centre of the votes round it.

    Among seeds of one joint that are close to each other, only the one with most votes is followed.
    """
    joints, points = seeds(scene, wanted, known)
    if not len(joints):
        return no_nodes()
    votes, _ = vote_points(scene, joints, points, at_rest(points, scene), 1.0)
    good = votes > PROMISE * wanted.threshold
    joints, points, votes = joints[good], points[good], votes[good]
    first = distinct(points, joints, votes, SPACING)
    nodes = moved(scene, joints[first], points[first], wanted.view_threshold)
    return selected(nodes, distinct(nodes.points, nodes.joints, nodes.votes, SPACING))


def seeds(scene: VoteScene, wanted: NodeCriteria, known: KnownNodes) -> tuple[Array, Array]:
    """Return joints (S,) and points (S, 3) m where rays of `wanted.min_views` (two or more) views meet.

    Args:
        known: Nodes that explain peaks; explained peaks give no seeds.
    """
    peaks = known.unexplained(scene, find_peaks(scene, wanted.view_threshold))
    found: tuple[Array, Array] = pair_seeds(scene, peaks, max(wanted.min_views, 2))
    return found


@njit(cache=True, error_model="numpy", nogil=True)
def pixel_rays(cameras, views, pixels):
    """Return the unit viewing rays (K, 3) in the world of pixels (K, 2) of the views (K,); NaN if none.

    Args:
        cameras: See `camera_records`.
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


@njit(cache=True, error_model="numpy", nogil=True)
def pair_seeds(scene, peaks, enough):
    """Return points where rays of a joint's 2D peaks meet: joints (S,), seeds (S, 3) m.

    Two rays of different views that pass within `GAP` give the point midway. It then moves twice to the point
    closest to the nearest ray of each view. The first move uses rays within `GAP`, the second within half of
    it. The seed counts if at least `enough` views have such rays in both moves. These rays are not paired
    with each other again.

    Args:
        peaks: `ImagePeaks`.
        enough: Least number of views.
    """
    start, pixels = peaks
    count, joint_count = len(scene.cameras), scene.map_start.shape[1]
    centres, views = np.empty((count, 3)), np.empty(len(pixels), np.int64)
    for v in range(count):
        camera = scene.cameras[v]
        centres[v, 0], centres[v, 1], centres[v, 2] = camera.ox, camera.oy, camera.oz
        views[start[v * joint_count] : start[(v + 1) * joint_count]] = v
    rays = pixel_rays(scene.cameras, views, pixels)
    paired = spread_views(centres, np.ones(count, np.bool_), PAIRED_VIEWS)
    joints, seeds = np.zeros(0, np.int64), np.zeros((0, 3))
    for joint in range(joint_count):
        mine = np.zeros(len(pixels), np.bool_)
        for v in range(count):
            key = v * joint_count + joint
            mine[start[key] : start[key + 1]] = True
        found = _seeds_of_joint(_Rays(views[mine], rays[mine], centres), paired, enough)
        joints = np.concatenate((joints, np.full(len(found), joint)))
        seeds = np.concatenate((seeds, found))
    return joints, seeds


@njit(cache=True, error_model="numpy", nogil=True)
def _seeds_of_joint(rays, paired, enough):
    """Return seeds (S, 3) m from the rays of one joint."""
    views, count = rays.views, len(rays.views)
    together = np.zeros((count, count), np.bool_)
    seeds, total = np.empty((count * (count - 1) // 2, 3)), 0
    nearest = np.empty(len(paired), np.int64)
    for a in range(count):
        for b in range(a + 1, count if paired[views[a]] else 0):
            if views[a] == views[b] or together[a, b] or not paired[views[b]]:
                continue
            point, met = _meeting(rays, a, b)
            for step in range(2 if met else 0):
                point, near = _closest_to_rays(rays, point, GAP / (1 + step), nearest)
                met = met and near >= enough
            if not met:
                continue
            seeds[total, 0], seeds[total, 1], seeds[total, 2] = point
            total += 1
            for k in range(near):
                for m in range(k + 1, near):
                    together[nearest[k], nearest[m]] = True
    return seeds[:total].copy()


@inlined
def _meeting(rays, p, q):
    """Return the point midway where rays p and q come closest, and whether they do so within the limits."""
    ax, ay, az = rays.directions[p, 0], rays.directions[p, 1], rays.directions[p, 2]
    bx, by, bz = rays.directions[q, 0], rays.directions[q, 1], rays.directions[q, 2]
    v, w, centres = rays.views[p], rays.views[q], rays.centres
    ox, oy, oz = centres[w, 0] - centres[v, 0], centres[w, 1] - centres[v, 1], centres[w, 2] - centres[v, 2]
    ab = ax * bx + ay * by + az * bz
    ao, bo = ax * ox + ay * oy + az * oz, bx * ox + by * oy + bz * oz
    sine2 = 1.0 - ab * ab
    a, b = (ao - ab * bo) / sine2, (ab * ao - bo) / sine2  # depths
    near = sine2 > 1e-6 and 0.0 < a < MAX_DEPTH and 0.0 < b < MAX_DEPTH  # False for NaN
    dx, dy, dz = ox + b * bx - a * ax, oy + b * by - a * ay, oz + b * bz - a * az
    middle = (
        centres[v, 0] + a * ax + 0.5 * dx,
        centres[v, 1] + a * ay + 0.5 * dy,
        centres[v, 2] + a * az + 0.5 * dz,
    )
    return middle, near and dx * dx + dy * dy + dz * dz <= GAP * GAP


@inlined
def _closest_to_rays(rays, point, gate, nearest):
    """Return the point closest to the nearest ray of each view within the gate, and the number of views.

    The indices of these rays are written to `nearest`.
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
