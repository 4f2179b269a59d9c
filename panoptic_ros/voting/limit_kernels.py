"""Compiled kernels that say which halves of a box a view's limit hides.

`limits` is that of `VoteScene`. Its pyramids hold the nearest and the farthest limit of ever more cells: what
is nearer than the nearest is not hidden, what is farther than the farthest is.
"""
from __future__ import annotations

from panoptic_ros.kernels import inlined, njit
from panoptic_ros.voting.rectangle_kernels import NONE, PART, SEES, TINY, U0, U1, W0, W1, corner


@njit(cache=True, error_model="numpy", nogil=True)
def build_limits(layers, reach, limits):
    """Fill the pyramids `reach` (N, 2) of the nearest and farthest limits; layers (V, L, 3) as of maps."""
    for v in range(len(layers)):
        columns, rows = int(limits[3 * v + 1]), int(limits[3 * v + 2])
        first, width = layers[v, 0, 0], layers[v, 0, 1]
        for k in range(rows):
            for i in range(columns):
                reach[first + k * width + i] = limits[int(limits[3 * v]) + k * columns + i]
        for layer in range(1, layers.shape[1]):
            if layers[v, layer, 1] == 0:
                break
            below, wide = first, width
            first, width = layers[v, layer, 0], layers[v, layer, 1]
            for k in range(0, rows, 2):
                for i in range(0, columns, 2):
                    a, step = below + k * wide + i, 1 if i + 1 < columns else 0
                    b = a + (wide if k + 1 < rows else 0)
                    nearest = min(min(reach[a, 0], reach[a + step, 0]), min(reach[b, 0], reach[b + step, 0]))
                    farthest = max(max(reach[a, 1], reach[a + step, 1]), max(reach[b, 1], reach[b + step, 1]))
                    at = first + (k >> 1) * width + (i >> 1)
                    reach[at, 0], reach[at, 1] = nearest, farthest
            columns, rows = (columns + 1) // 2, (rows + 1) // 2


@inlined
def hide(scene, v, box, lanes):
    """Of what view v of a `BoxScene` sees of the halves of a box, take away what is hidden."""
    view, limits, layers, reach = scene.cameras[v], scene.limits, scene.limit_layers, scene.limit_reach
    deep = (box.half * (1.0 + TINY) + TINY) * scene.bounds[v].across
    columns, rows = int(limits[3 * v + 1]), int(limits[3 * v + 2])
    across, down = columns / view.width, rows / view.height
    for c in range(8):
        if lanes[SEES, c] == NONE:
            continue
        i0 = min(int((lanes[U0, c] + 0.5) * across), columns - 1)
        i1 = min(int((lanes[U1, c] + 0.5) * across), columns - 1)
        k0 = min(int((lanes[W0, c] + 0.5) * down), rows - 1)
        k1 = min(int((lanes[W1, c] + 0.5) * down), rows - 1)
        layer = 0
        while (i1 >> layer) - (i0 >> layer) > 1 or (k1 >> layer) - (k0 >> layer) > 1:
            layer += 1
        a = layers[v, layer, 0] + (k0 >> layer) * layers[v, layer, 1] + (i0 >> layer)
        right = (i1 >> layer) - (i0 >> layer)
        b = a + ((k1 >> layer) - (k0 >> layer)) * layers[v, layer, 1]
        nearest = min(min(reach[a, 0], reach[a + right, 0]), min(reach[b, 0], reach[b + right, 0]))
        farthest = max(max(reach[a, 1], reach[a + right, 1]), max(reach[b, 1], reach[b + right, 1]))
        x, y, z = corner(box, c)
        depth = view.r20 * x + view.r21 * y + view.r22 * z + view.tz
        if depth - deep > farthest:
            lanes[SEES, c] = NONE
        elif depth + deep > nearest:
            lanes[SEES, c] = min(lanes[SEES, c], PART)
