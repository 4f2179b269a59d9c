"""What views of several stamps say of the motion of joints."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """What the views say of K people's J joints in motion.

    covariances: (K, J, 3, 3) m^2, of positions at the assumed velocity. delays (K, J, 3, 3) s,
    velocities (K, J, 3) m/s and information (K, J, 3, 3): see `TimeShift`.
    """

    covariances: Array
    delays: Array
    velocities: Array
    information: Array
