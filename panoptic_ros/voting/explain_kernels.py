"""Compiled kernels that tell which 2D peaks known joints explain."""
from __future__ import annotations

import math

import numpy as np

from panoptic_ros.kernels import inlined, njit
from panoptic_ros.voting.lanes import COVERED, DEPTH, LANES, SIZE, U, W, X, Y, Z, place, see

CELLS = 2.0  # of a score map, within which a joint explains a peak
REACH = 0.06  # m, the same where a person is large in the image
WIDTHS = 1.5  # the same for keypoints, in standard deviations of their Gaussians


@njit(cache=True, error_model="numpy", nogil=True)
def unexplained_peaks(scene, peaks, known):
    """Which `ImagePeaks` (K,) are not near to where a joint of their kind is seen; known: `Explainer`."""
    start, pixels = peaks
    joints, points, moves = known.nodes.joints, known.nodes.points, known.velocities
    joint_count = scene.map_start.shape[1]
    left, lanes = np.ones(len(pixels), np.bool_), np.zeros(SIZE)
    for v in range(len(scene.cameras)):
        for first in range(0, len(points), LANES):
            count, late = min(LANES, len(points) - first), known.delays[v]
            for c in range(count):
                n = first + c
                place(lanes, c, points[n, 0] + moves[n, 0] * late, points[n, 1] + moves[n, 1] * late,
                      points[n, 2] + moves[n, 2] * late)  # fmt: skip
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
    """How near, px, point c must be seen to explain peak k of a joint in view v."""
    camera = scene.cameras[v]
    far = lanes[DEPTH + c]
    if camera.fisheye > 0.0:  # sizes go by angles
        x, y, z = lanes[X + c] - camera.ox, lanes[Y + c] - camera.oy, lanes[Z + c] - camera.oz
        far = math.sqrt(x * x + y * y + z * z)
    reach = REACH * max(camera.fx, camera.fy) / far
    if scene.map_start[v, joint] >= 0:
        return max(reach, CELLS / math.hypot(camera.a0, camera.a1))
    for i in range(scene.people.shape[2]):
        if scene.people[v, joint, i, 0] == pixels[k, 0] and scene.people[v, joint, i, 1] == pixels[k, 1]:
            return max(reach, WIDTHS * math.sqrt(0.5 / scene.people[v, joint, i, 2]))
    return reach
