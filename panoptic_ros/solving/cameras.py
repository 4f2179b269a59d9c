"""The cameras of one instant and what they saw, as the kernels take them."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

Array = np.ndarray


class Cameras(NamedTuple):
    """Where V cameras are, and when each of them looked.

    rotations (V, 3, 3) and translations (V, 3) m: cam_from_world. delays (V,) s: stamp of the view less that
    of the instant, 0 where motion between them is not allowed for.
    """

    rotations: Array
    translations: Array
    delays: Array


class Observations(NamedTuple):
    """All 2D joints of one instant: V views, D 2D people ordered by view.

    plane (D, J, 2) undistorted normalised points. precision (D, J) 1 / standard deviation on that plane, 0 =
    missing. views (D,) of each 2D person. starts (V + 1,) first 2D person of each view. cams: of the views.
    """

    plane: Array
    precision: Array
    views: Array
    starts: Array
    cams: Cameras
