"""One colour per identity, the same in every picture."""

from __future__ import annotations

import colorsys

GOLDEN = 0.6180339887498949  # neighbouring ids get hues that are far apart
FIRST_HUE = 0.08


def rgb_of(identity: int) -> tuple[float, float, float]:
    """Colour of an id, red green blue in 0..1: bright, and told apart for some dozen ids."""
    hue = (FIRST_HUE + GOLDEN * int(identity)) % 1.0
    return colorsys.hsv_to_rgb(hue, 0.85 if int(identity) % 2 == 0 else 0.6, 1.0)


def bgr_of(identity: int) -> tuple[int, int, int]:
    """Colour of an id for OpenCV, blue green red in 0..255."""
    red, green, blue = rgb_of(identity)
    return round(255 * blue), round(255 * green), round(255 * red)
