"""False people: some at fixed places of the background, some anywhere."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from panoptic_ros.domain import Camera
from panoptic_ros.simulation.people import draw_person
from panoptic_ros.simulation.skeleton import JOINTS

Array = np.ndarray
STEADY = 0.8  # probability that a ghost at a fixed place shows, per frame
FIXED_SHARE = 0.5  # of all ghosts
FOUND = 0.7  # share of a ghost's joints that are reported
FEWEST = 4  # joints
TEMPLATES = 8


class Ghosts:
    """The false people of every camera. `rate` is their mean number per view."""

    def __init__(self, rng: np.random.Generator, rate: float, noise_px: float, cameras: Sequence[Camera]):
        self._rate, self._noise, self._cameras = rate, noise_px, cameras
        self._templates = [_template(rng) for _ in range(TEMPLATES)]
        counts = rng.poisson(FIXED_SHARE * rate / STEADY, len(cameras))
        self._fixed = [[self._place(rng, c) for _ in range(n)] for c, n in zip(cameras, counts)]

    def appear(self, rng: np.random.Generator, camera: int) -> list[tuple[Array, Array]]:
        """Points (19, 2) px, NaN = missing, and scores (19,) of the ghosts in one image."""
        shapes = [place for place in self._fixed[camera] if rng.random() < STEADY]
        count = rng.poisson((1.0 - FIXED_SHARE) * self._rate)
        shapes += [self._place(rng, self._cameras[camera]) for _ in range(count)]
        ghosts = []
        for shape in shapes:
            points = shape + self._noise * rng.standard_normal(shape.shape)
            found = (rng.random(len(JOINTS)) < FOUND) & self._cameras[camera].contains(points)
            scores = rng.uniform(0.15, 0.75, len(JOINTS))
            if found.sum() >= FEWEST:
                ghosts.append((np.where(found[:, None], points, np.nan), np.where(found, scores, 0.0)))
        return ghosts

    def _place(self, rng: np.random.Generator, camera: Camera) -> Array:
        """A template (19, 2) px somewhere in the image."""
        width, height = camera.image_size
        middle = rng.uniform(0.1, 0.9, 2) * [width, height]
        size = height * rng.uniform(0.15, 0.5)
        return middle + size * self._templates[int(rng.integers(TEMPLATES))]


def _template(rng: np.random.Generator) -> Array:
    """Somebody who stands, seen from a side, (19, 2) of height 1 round 0, y down."""
    person = draw_person(rng, 0, "stand", 1.7, 0.1)
    angle = rng.uniform(0.0, 2.0 * np.pi)
    joints = person.joints(rng.uniform(0.0, 10.0, 1))[0]
    across = joints[:, :2] @ np.array([np.cos(angle), np.sin(angle)])
    flat = np.column_stack([across, -joints[:, 2]])
    shape: Array = (flat - flat.mean(axis=0)) / np.ptp(flat[:, 1])
    return shape
