"""Options of the continuous pass."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ContinuousConfig:
    """Options of the pass.

    Args:
        clocks: estimate the clocks of the cameras.
        rolling_shutter: estimate their line delays.
        trusted_camera: camera whose clock and line delay are right. "": most clocks are right if they agree,
            else their mean is.
    """

    clocks: bool = False
    rolling_shutter: bool = False
    trusted_camera: str = ""
