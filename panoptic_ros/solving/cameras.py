"""The cameras of one instant, as the kernels take them."""
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
