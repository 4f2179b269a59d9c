"""One depth sensor: a camera that measures distances."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

from panoptic_ros.domain.camera import Camera
from panoptic_ros.errors import CalibrationError


@dataclass(frozen=True, slots=True, eq=False)
class DepthSensor:
    """Depth sensor with intrinsics, a pose and a clock of its own.

    Args:
        camera: Name, size of the depth maps, intrinsics, pose and clock of the sensor.
        colour_camera: Name of the rig camera that is in the same housing as the sensor; "" = none.
        unit_m: Metres per count, if the depth maps are stored as integers.

    Raises:
        CalibrationError: on a unit that is not positive, or a sensor that names itself as its colour camera.
    """

    camera: Camera
    colour_camera: str = ""
    unit_m: float = 0.001

    def __post_init__(self) -> None:
        object.__setattr__(self, "unit_m", float(self.unit_m))
        if not (self.unit_m > 0.0 and isfinite(self.unit_m)):
            raise CalibrationError(
                f"depth sensor {self.name}: unit_m is {self.unit_m}, expected metres above 0"
            )
        if self.colour_camera == self.name:
            raise CalibrationError(f"depth sensor {self.name} is its own colour camera; give it another name")

    @property
    def name(self) -> str:
        """Return the name of the sensor."""
        return self.camera.name
