"""Assign one colour to each identity, the same in every image."""

from __future__ import annotations

import colorsys

GOLDEN = 0.6180339887498949  # golden ratio minus 1: successive ids get distant hues
FIRST_HUE = 0.08


def rgb_of(identity: int) -> tuple[float, float, float]:
    """Return the RGB colour (0..1) of an id; some dozen ids are distinguishable."""
    hue = (FIRST_HUE + GOLDEN * int(identity)) % 1.0
    return colorsys.hsv_to_rgb(hue, 0.85 if int(identity) % 2 == 0 else 0.6, 1.0)


def bgr_of(identity: int) -> tuple[int, int, int]:
    """Return the BGR colour (0..255) of an id for OpenCV."""
    red, green, blue = rgb_of(identity)
    return round(255 * blue), round(255 * green), round(255 * red)
