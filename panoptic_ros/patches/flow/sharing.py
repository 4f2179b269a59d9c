"""How the views that see somebody share the points on him.

Some views tell the motion of a part from all sides; more of them say the same again. So where many see a
person, each follows a share of the points on him, not the same ones as its neighbour: a person costs the
same in rigs of any size. No camera hears from another: the size of a 2D person tells about how far it is,
and the rig which cameras see that place, and how large.
"""

from __future__ import annotations

import numpy as np

from panoptic_ros.domain import Camera, Rig

Array = np.ndarray
ALONG_BORDER = 9  # points of each border of an image, of which the field of view is made
LARGE = 0.5  # of the size at which a camera sees a person, for others to count
APART = 0.5 * (np.sqrt(5.0) - 1.0)  # of one, by which cameras begin to leave points out one after the other


class Sharing:
    """Which points each camera of a rig follows.

    Args:
        views: that follow all points of a person; 0 = as many as there are.
    """

    def __init__(self, rig: Rig, views: int):
        stack = rig.stack()
        self._rig, self._views = rig, views
        self._rotations, self._translations, self._focals = stack.rotations, stack.translations, stack.focals
        fields = [_field_of_view(camera) for camera in rig.cameras]
        self._lowest, self._highest = (np.array([field[end] for field in fields]) for end in (0, 1))

    def shares(self, camera: str, middles: Array, scales: Array) -> Array:
        """Which share (P,) of the points on each 2D person a camera follows.

        Args:
            middles: (P, 2) px. scales: (P,) px per metre; NaN = not known, nobody is followed there.
        """
        if not 0 < self._views < len(self._rig) or not len(middles):
            return np.ones(len(middles))
        own = self._rig.index(camera)
        depths = self._focals[own] / scales
        plane = self._rig.cameras[own].intrinsics.undistort(middles).reshape(-1, 2)
        ahead = depths[:, None] * np.column_stack([plane, np.ones(len(plane))])
        places = (ahead - self._translations[own]) @ self._rotations[own]
        count = self._seeing(places, LARGE * scales)
        return np.where(count > self._views, self._views / np.maximum(count, 1), 1.0)

    def followed(self, camera: str, persons: Array, shares: Array) -> Array:
        """Which (N,) of the points on people (N,), ordered by person, are in these shares (P,)."""
        number = np.arange(len(persons)) - np.searchsorted(persons, persons)  # of each person's points
        own, phase = shares[persons], self._rig.index(camera) * APART
        chosen: Array = (number * own + phase) % 1.0 < own
        return chosen

    def _seeing(self, places: Array, scales: Array) -> Array:
        """How many cameras (P,) see places (P, 3) m, at these scales (P,) px per metre or larger."""
        local = np.einsum("cij,pj->cpi", self._rotations, places) + self._translations[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            plane = local[..., :2] / local[..., 2:]
        inside = (plane >= self._lowest[:, None]) & (plane <= self._highest[:, None])
        near = (local[..., 2] > 0.0) & (local[..., 2] * scales <= self._focals[:, None])
        count: Array = (inside.all(axis=-1) & near).sum(axis=0)
        return count


def _field_of_view(camera: Camera) -> tuple[Array, Array]:
    """The least and the largest x and y (2,) on the plane at distance 1 that an image shows."""
    width, height = camera.image_size
    x, y = np.linspace(0.0, width - 1.0, ALONG_BORDER), np.linspace(0.0, height - 1.0, ALONG_BORDER)
    borders = [np.column_stack([x, np.full_like(x, end)]) for end in (0.0, height - 1.0)]
    borders += [np.column_stack([np.full_like(y, end), y]) for end in (0.0, width - 1.0)]
    plane = camera.intrinsics.undistort(np.concatenate(borders)).reshape(-1, 2)
    if not np.isfinite(plane).all():  # a lens that shows all that is in front
        return np.full(2, -np.inf), np.full(2, np.inf)
    return plane.min(axis=0), plane.max(axis=0)
