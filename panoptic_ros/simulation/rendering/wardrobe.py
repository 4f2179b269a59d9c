"""Appearance of simulated people."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

Array = np.ndarray
SKINS = ((150, 180, 225), (135, 165, 215), (120, 155, 205), (95, 130, 185), (60, 85, 130))  # BGR
HAIRS = ((20, 22, 28), (25, 40, 60), (40, 80, 120), (70, 70, 75), (60, 110, 165))
TROUSER_HUES = (105, 110, 115, 15, 0)  # hue of 180: blues, browns


@dataclass(frozen=True, eq=False)
class Appearance:
    """Colours (3,) BGR 0..255 and style of one person."""

    skin: Array
    hair: Array
    shirt: Array
    trousers: Array
    shoes: Array
    girth: float  # scale of the body's girth, 1 = average
    long_sleeves: bool
    long_hair: bool
    stripes: bool

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Appearance:
        """Draw a random appearance."""
        shirt = _colour(rng.integers(180), rng.integers(60, 200), rng.integers(90, 230))
        trousers = _colour(rng.choice(TROUSER_HUES), rng.integers(10, 120), rng.integers(35, 110))
        return cls(
            skin=np.array(SKINS[rng.integers(len(SKINS))], np.float64),
            hair=np.array(HAIRS[rng.integers(len(HAIRS))], np.float64),
            shirt=shirt,
            trousers=trousers,
            shoes=0.35 * trousers + rng.uniform(10.0, 40.0),
            girth=float(rng.uniform(0.92, 1.14)),
            long_sleeves=bool(rng.random() < 0.5),
            long_hair=bool(rng.random() < 0.35),
            stripes=bool(rng.random() < 0.25),
        )


def _colour(hue: np.int64, saturation: np.int64, value: np.int64) -> Array:
    pixel = np.array([[[hue, saturation, value]]], np.uint8)
    colour: Array = cv2.cvtColor(pixel, cv2.COLOR_HSV2BGR)[0, 0].astype(np.float64)
    return colour
