"""Decoder of centre heads for one person: MoveNet SinglePose on a crop round the person.

It follows MoveNet's own post-processing. The person's centre is the maximum of the centre map divided by the
distance to the middle of the crop. The network regresses the joints from there. Each joint is the maximum of
its map divided by the distance to the regressed place. The offset that is regressed in that cell is added.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

Array = np.ndarray
SOFTENING = 1.8  # cells added to the distances


def decode_single_heads(heads: Mapping[str, Array], stride: int) -> tuple[Array, Array]:
    """Decode the joints (K, 2) of a person in px of the network input, and their scores (K,).

    The origin is the corner of the image.

    Args:
        heads: `center` (1, h, w) and `heat` (K, h, w) in 0..1; `regress` and `offset` (2 K, h, w) in cells, y
            before x.
        stride: px of the network input per cell.
    """
    heat = heads["heat"]
    joint_count, rows, columns = heat.shape
    middle = np.array([[rows / 2.0, columns / 2.0]])
    weighted = heads["center"] / (_distances(middle, rows, columns) + SOFTENING)
    y, x = divmod(int(weighted.argmax()), columns)
    guess = heads["regress"][:, y, x].reshape(joint_count, 2) + (y, x)
    near = heat / (_distances(guess, rows, columns) + SOFTENING)
    cells = np.stack(np.divmod(near.reshape(joint_count, -1).argmax(axis=1), columns), axis=1)
    each = np.arange(joint_count)
    own = heads["offset"].reshape(joint_count, 2, rows, columns)[each, :, cells[:, 0], cells[:, 1]]
    return stride * (cells + own)[:, ::-1].astype(float), heat[each, cells[:, 0], cells[:, 1]].astype(float)


def _distances(places: Array, rows: int, columns: int) -> Array:
    """Return the distance (N, rows, columns) of every cell from N places (row, column)."""
    down = (np.arange(rows) - places[:, :1]) ** 2
    across = (np.arange(columns) - places[:, 1:]) ** 2
    distances: Array = np.sqrt(down[:, :, None] + across[:, None, :])
    return distances
