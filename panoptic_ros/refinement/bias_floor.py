"""What smoothing does not remove: constant biases of the detector, stated in the covariances at the end."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from panoptic_ros.domain import RefinedPoseSet, SkeletonModel

Array = np.ndarray


def bias_floor(asked: float, skeleton: SkeletonModel) -> Array:
    """Covariances (J, 3, 3) m^2 of the detector's biases.

    Args:
        asked: m, standard deviation per axis of every joint; negative = those of the skeleton, or none.
    """
    own = np.array(skeleton.bias_floors) if skeleton.bias_floors else np.zeros(len(skeleton))
    floors = own if asked < 0.0 else np.full(len(skeleton), asked)
    return (floors**2)[:, None, None] * np.eye(3)


def with_floor(sets: Sequence[RefinedPoseSet], floor: Array) -> tuple[RefinedPoseSet, ...]:
    """The sets with floor (J, 3, 3) m^2 added to all covariances.

    A bias is the same in every frame: as noise of single measurements it would be smoothed away, and make the
    smoother sluggish.
    """
    if not floor.any():
        return tuple(sets)
    return tuple(replace(item, covariances=item.covariances + floor) for item in sets)
