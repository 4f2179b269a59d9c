"""2D peaks of all views: local maxima of the score maps, and keypoints of joints without maps.

Nodes of known people explain peaks away.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain.of_all import selected
from panoptic_ros.kernels import inlined, njit
from panoptic_ros.voting.proposals import NodeProposals, no_nodes
from panoptic_ros.voting.scene import VoteScene
from panoptic_ros.voting.votes import COVERED, DEPTH, LANES, SIZE, U, W, X, Y, Z, place, see

Array = np.ndarray
CELLS = 2.0  # cells of a score map, within which a joint explains a peak
REACH = 0.06  # m, limit as CELLS, in space; it is the larger one where a person is large in the image
WIDTHS = 1.5  # limit as CELLS for keypoints, in standard deviations of their Gaussians


class ImagePeaks(NamedTuple):
    """2D peaks of all views.

    Args:
        start: (V * J + 1) index of the first peak of view v and joint j at v * J + j.
        pixels: (K, 2) px.
    """

    start: Array
    pixels: Array


class KnownNodes(NamedTuple):
    """Known nodes, which explain 2D peaks.

    Args:
        nodes: The nodes.
        velocities: (N, 3) m/s.
        delays: (V,) s, exposure of each view's middle row minus the instant of the nodes.
    """

    nodes: NodeProposals
    velocities: Array
    delays: Array

    @classmethod
    def of_nobody(cls, delays: Array) -> KnownNodes:
        """Return an instance without nodes."""
        return cls(no_nodes(), np.zeros((0, 3)), delays)

    def rows(self, which: Array) -> KnownNodes:
        """Return an instance with the nodes at these indices only."""
        return KnownNodes(selected(self.nodes, which), self.velocities[which], self.delays)

    def unexplained(self, scene: VoteScene, peaks: ImagePeaks) -> ImagePeaks:
        """Return the 2D peaks that are not near the projection of a node of their joint."""
        left = unexplained_peaks(scene, peaks, self)
        return ImagePeaks(np.concatenate([[0], np.cumsum(left)])[peaks.start], peaks.pixels[left])


@njit(cache=True, error_model="numpy", nogil=True)
def find_peaks(scene, threshold):
    """Return the 2D peaks of the joints of a `VoteScene` above a threshold.

    A peak is a 3x3 local maximum of the merged maps. Its position is the centroid of the window, weighted by
    the squared score. Among equal neighbours, the first one is the peak. Among overlapping patches, the first
    one with the largest value has it.
    """
    views, joint_count, most, _ = scene.people.shape
    start = np.zeros(views * joint_count + 1, np.int64)
    pixels = np.empty((views * joint_count * most + len(scene.patch_data), 2))  # an upper bound
    total = np.int64(0)  # a literal 0 is a type of its own: numba would compile all parts for it too
    for v in range(views):
        for j in range(joint_count):
            if scene.map_start[v, j] < 0:
                total = _add_keypoints(scene.people, v, j, threshold, pixels, total)
            else:
                total = _add_map_peaks(scene, v, j, threshold, pixels, total)
            start[v * joint_count + j + 1] = total
    return ImagePeaks(start, pixels[:total].copy())


@inlined
def _add_keypoints(people, v, j, threshold, pixels, total):
    """Write 2D joints above the threshold to pixels[total] and on; return the new total."""
    for i in range(people.shape[2]):
        if people[v, j, i, 3] > threshold:
            pixels[total, 0], pixels[total, 1] = people[v, j, i, 0], people[v, j, i, 1]
            total += 1
    return total


@inlined
def _add_map_peaks(scene, v, j, threshold, pixels, total):
    """Write the peaks of a map to pixels[total] and on; return the new total."""
    camera, table, least = scene.cameras[v], scene.patch_table, int(255.0 * threshold)  # int: compares faster
    det = camera.a0 * camera.b1 - camera.a1 * camera.b0
    data, key = scene.patch_data, v * scene.map_start.shape[1] + j
    for k in range(scene.patch_start[key], scene.patch_start[key + 1]):
        column, row, width, height, first = table[k, 1], table[k, 2], table[k, 3], table[k, 4], table[k, 5]
        for y in range(height):
            at, before = first + y * width, -1
            for x in range(width):
                value = int(data[at + x])
                after = int(data[at + x + 1]) if x + 1 < width else 0
                if (value > least) & (value > before) & (value >= after):
                    peak, a, b = _centroid(scene, v, j, column + x, row + y, value)
                    if peak and not _in_earlier_patch(scene, key, k, column + x, row + y, value):
                        a, b = a - camera.a2, b - camera.b2
                        pixels[total, 0] = (camera.b1 * a - camera.a1 * b) / det
                        pixels[total, 1] = (camera.a0 * b - camera.b0 * a) / det
                        total += 1
                before = value
    return total


@inlined
def _centroid(scene, v, j, x, y, value):
    """Return whether a cell of a merged map is a peak of this value, and the centroid of its 3x3 window."""
    first, columns, rows = scene.map_start[v, j], int(scene.cameras[v].columns), int(scene.cameras[v].rows)
    total, sum_x, sum_y = 0, 0, 0
    for step in range(9):
        a, b = x + step % 3 - 1, y + step // 3 - 1
        inside = (a >= 0) & (a < columns) & (b >= 0) & (b < rows)
        other = int(scene.map_data[first + b * columns + a]) if inside else 0
        if other > value or (step < 4 and other == value):
            return False, 0.0, 0.0
        total, sum_x, sum_y = total + other * other, sum_x + other * other * a, sum_y + other * other * b
    return True, sum_x / total, sum_y / total


@inlined
def _in_earlier_patch(scene, key, k, x, y, value):
    """Return whether an earlier patch than k of a view and joint has this value at a cell."""
    for other in range(scene.patch_start[key], k):
        _, column, row, width, height, first = scene.patch_table[other]
        if column <= x < column + width and row <= y < row + height:
            if scene.patch_data[first + (y - row) * width + x - column] == value:
                return True
    return False


@njit(cache=True, error_model="numpy", nogil=True)
def unexplained_peaks(scene, peaks, known):
    """Return which 2D peaks (K,) are not near the projection of a known node of their joint.

    Args:
        scene: `VoteScene`.
        peaks: `ImagePeaks`.
        known: `KnownNodes`.
    """
    start, pixels = peaks
    joints, points, moves = known.nodes.joints, known.nodes.points, known.velocities
    joint_count = scene.map_start.shape[1]
    left, lanes = np.ones(len(pixels), np.bool_), np.zeros(SIZE)
    for v in range(len(scene.cameras)):
        for first in range(0, len(points), LANES):
            count, late = min(LANES, len(points) - first), known.delays[v]
            for c in range(count):
                n = first + c
                place(
                    lanes,
                    c,
                    points[n, 0] + moves[n, 0] * late,
                    points[n, 1] + moves[n, 1] * late,
                    points[n, 2] + moves[n, 2] * late,
                )
            see(scene.cameras, scene.limits, v, lanes)
            for c in range(count):
                key = v * joint_count + joints[first + c]
                for k in range(start[key], start[key + 1] if lanes[COVERED + c] > 0.0 else start[key]):
                    near = _near(scene, v, joints[first + c], pixels, k, lanes, c)
                    if (pixels[k, 0] - lanes[U + c]) ** 2 + (pixels[k, 1] - lanes[W + c]) ** 2 <= near * near:
                        left[k] = False
    return left


@inlined
def _near(scene, v, joint, pixels, k, lanes, c):
    """Return the distance, px, within which the projection of point c explains peak k in view v."""
    camera = scene.cameras[v]
    far = lanes[DEPTH + c]
    if camera.fisheye > 0.0:  # image sizes depend on the angle
        x, y, z = lanes[X + c] - camera.ox, lanes[Y + c] - camera.oy, lanes[Z + c] - camera.oz
        far = math.sqrt(x * x + y * y + z * z)
    reach = REACH * max(camera.fx, camera.fy) / far
    if scene.map_start[v, joint] >= 0:
        return max(reach, CELLS / math.hypot(camera.a0, camera.a1))
    for i in range(scene.people.shape[2]):
        if scene.people[v, joint, i, 0] == pixels[k, 0] and scene.people[v, joint, i, 1] == pixels[k, 1]:
            return max(reach, WIDTHS * math.sqrt(0.5 / scene.people[v, joint, i, 2]))
    return reach
