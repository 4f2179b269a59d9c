"""Offsets of a detector's joints from those of a skeleton's definition, constant in the torso frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain.checks import ShapeChecks
from panoptic_ros.errors import ConfigError
from panoptic_ros.geometry.torso import torso_frames

Array = np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class BiasTable:
    """Offsets to add to the joints of a skeleton, after Malleson et al. 2020, 3.3.2.

    Detectors learn joints from pictures, so their shoulders and hips are not the centres of rotation. All
    views share this error, so triangulation cannot reveal it. A comparison with a reference can.

    Args:
        name: Name of the table.
        offsets: (J, 3) from the detector's joint to the reference joint: forward, left, up, in torso lengths.
        torso: Joint indices of left shoulder, right shoulder, left hip, right hip.

    Raises:
        ConfigError: if an offset is not finite or is as long as a torso.
    """

    name: str
    offsets: Array
    torso: tuple[int, int, int, int]

    def __post_init__(self) -> None:
        offsets = ShapeChecks(self).store("offsets", np.float64, "J 3")
        if not (np.abs(offsets) < 1.0).all():
            raise ConfigError(f"bias table {self.name}: an offset is not below one torso length")

    def corrected(self, positions: Array) -> Array:
        """Return joints (P, J, 3) m with the offsets added. Missing joints stay missing."""
        corrected: Array = positions + self.corrections(positions)
        return corrected

    def corrections(self, positions: Array) -> Array:
        """Return the offsets (P, J, 3) m of joints (P, J, 3) m.

        They are 0 for people with an incomplete torso, because the torso frame is then unknown.
        """
        axes, lengths = torso_frames(positions[:, list(self.torso)])
        shifts = np.einsum("pik,jk->pji", axes, self.offsets) * lengths[:, None, None]
        return np.where(np.isfinite(shifts), shifts, 0.0)
