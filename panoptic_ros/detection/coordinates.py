"""Affine maps from a network's coordinates to pixels, and from pixels to cells of its maps."""

from __future__ import annotations

import numpy as np

from panoptic_ros.detection.card import ModelCard

Array = np.ndarray


def net_from_model(card: ModelCard) -> Array:
    """Return the (2, 3) map from the network's coordinates to px with the first pixel's centre as origin."""
    half = 0.5 if card.coords.origin == "corner" else 0.0
    x, y = card.coords.shift_px
    return np.array([[1.0, 0.0, x - half], [0.0, 1.0, y - half]])


def grid_from_net(card: ModelCard, net_size: tuple[int, int], grid_size: tuple[int, int]) -> Array:
    """Return the (2, 3) affine map from input px (centre of the first pixel = 0) to cells of score maps.

    Args:
        net_size, grid_size: (height, width).
    """
    shift = np.array(card.coords.shift_px)
    if card.coords.udp:  # first and last cells lie on first and last pixels
        scale = (np.array(grid_size[::-1]) - 1.0) / (np.array(net_size[::-1]) - 1.0)
        offset = -shift * scale
    else:
        scale = np.full(2, 1.0 / card.stride)
        if card.coords.origin == "corner":  # a cell's centre is the centre of its pixels
            offset = (0.5 - shift) * scale - 0.5
        else:  # training put a joint at stride * c into cell c
            offset = -shift * scale
    return np.array([[scale[0], 0.0, offset[0]], [0.0, scale[1], offset[1]]])
