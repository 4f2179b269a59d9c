"""Appearance of the people of an image: colours of their clothes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain.checks import ShapeChecks, check_magnitude, check_stamp
from panoptic_ros.errors import DataError

Array = np.ndarray
REGIONS = ("torso", "legs")
CHANNELS = 3  # numbers per colour, see `ViewAppearance`
LARGEST = 10.0  # greatest absolute value of such a number


@dataclass(frozen=True, slots=True, eq=False)
class ViewAppearance:
    """Clothing colours of the P people of an image.

    Args:
        camera, stamp_ns, frame_number: Those of the image.
        colours: (P, 2, 3) of torso and legs (`REGIONS`): log green, log (red / green), log (blue / green) of
            the image values. A change of light affects only the first. NaN = not seen. The people are those
            of the image's `ViewDetections`.

    Raises:
        DataError: on shapes that do not fit, and colours that no image has.
    """

    camera: str
    stamp_ns: int
    frame_number: int
    colours: Array

    def __post_init__(self) -> None:
        if not self.camera:
            raise DataError("ViewAppearance without the name of its camera")
        object.__setattr__(self, "stamp_ns", check_stamp(self, self.stamp_ns))
        colours = ShapeChecks(self).store("colours", np.float32, f"P {len(REGIONS)} {CHANNELS}")
        if np.isinf(colours).any():
            raise DataError(f"ViewAppearance.colours of camera {self.camera} are infinite")
        check_magnitude(f"ViewAppearance.colours of camera {self.camera}", colours, LARGEST)
