"""How far the cameras of a rig see past the fixed things in the room."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from panoptic_ros.association.occluder_kernels import nearest_depths
from panoptic_ros.domain import Camera, DetectionSet, Occluders, Rig, ViewDetections, VisibilityLimit
from panoptic_ros.domain.visibility import LONGER_SIDE

Array = np.ndarray
MARGIN = 0.05  # m, how far calibrations and models of things are off


def occluded_depths(camera: Camera, occluders: Occluders) -> Array:
    """Depths (H, W) m beyond which things hide all of a cell of the image; infinite where they do not.

    Rays through the corners of a cell tell: the farthest of their first surfaces counts, so cells across an
    edge see on, and things that are smaller than cells hide nothing.
    """
    size = np.array(camera.image_size)
    columns, rows = np.maximum(1, np.round(size * min(1.0, LONGER_SIDE / size.max())).astype(int))
    u = np.arange(columns + 1) * (size[0] / columns) - 0.5
    w = np.arange(rows + 1) * (size[1] / rows) - 0.5
    plane = camera.intrinsics.undistort(np.stack(np.meshgrid(u, w), axis=-1))
    vertices = camera.cam_from_world.apply(occluders.vertices)
    depths = nearest_depths(plane, vertices[occluders.triangles])
    depths = np.maximum(depths[1:], depths[:-1])
    farthest: Array = np.maximum(depths[:, 1:], depths[:, :-1])
    return farthest


class KnownOccluders:
    """The limits that the occluders of a rig set; they are cast once."""

    def __init__(self, rig: Rig):
        self._limits: dict[str, VisibilityLimit] = {}
        if rig.occluders is not None:
            for camera in rig.cameras:
                depths = occluded_depths(camera, rig.occluders)
                if np.isfinite(depths).any():
                    self._limits[camera.name] = VisibilityLimit.of_depths(depths, MARGIN)

    def limit(self, item: DetectionSet) -> DetectionSet:
        """The set with views that see no farther than occluders let them; the same where there are none."""
        if not self._limits:
            return item
        return replace(item, views=tuple(self._limited(view) for view in item.views))

    def _limited(self, view: ViewDetections) -> ViewDetections:
        known = self._limits.get(view.camera)
        if known is None:
            return view
        return replace(view, limit=known if view.limit is None else known.combined(view.limit))
