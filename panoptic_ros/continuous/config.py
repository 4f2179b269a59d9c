"""Options of the continuous pass."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ContinuousConfig:
    """Options of the pass.

    Args:
        clocks: estimate offsets and drifts of the cameras' clocks.
        rolling_shutter: estimate the line delays of the cameras.
        trusted_camera: camera whose clock and line delay are right; "": most cameras if they agree, else the
            mean of all.
    """

    clocks: bool = False
    rolling_shutter: bool = False
    trusted_camera: str = ""
