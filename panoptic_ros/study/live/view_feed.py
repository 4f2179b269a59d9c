"""Load of a viewer: 2D poses of several persons, and ten preview images per second and camera."""

from __future__ import annotations

import numpy as np

from panoptic_ros.domain import Preview, Rig, ViewFrame
from panoptic_ros.io.previews import make_preview
from panoptic_ros.study.live.graph_feed import Feed, simulated_feed

SCENARIO = "noisy-8p10v"
PEOPLE, VIEWS, RATE_HZ = 8, 8, 30.0
PREVIEW_EVERY = 3  # time steps; 10 Hz


def view_load() -> Feed:
    """Return the simulated 2D poses of eight persons in eight cameras at 30 Hz."""
    return simulated_feed(SCENARIO, PEOPLE, VIEWS, RATE_HZ)


def moving_previews(rig: Rig, count: int = 20) -> list[dict[str, Preview]]:
    """Return moving preview images by camera, 11 kB each as in a real room; timestamps are 0."""
    rng = np.random.default_rng(0)
    pictures = {name: _picture(rng) for name in rig.names}
    return [
        {
            name: make_preview(ViewFrame(name, 0, number, np.roll(picture, 24 * number, axis=1)))
            for name, picture in pictures.items()
        }
        for number in range(count)
    ]


def _picture(rng: np.random.Generator) -> np.ndarray:
    """Return an HD image whose preview has 11 kB, as in a real room."""
    coarse = rng.integers(96, 160, (27, 48, 3), dtype=np.uint8)
    return np.kron(coarse, np.ones((40, 40, 1), np.uint8))
