"""Parameters of the health stage."""

from __future__ import annotations

from dataclasses import dataclass

from panoptic_ros.params import Config, param


@dataclass(frozen=True, kw_only=True)
class HealthConfig(Config):
    """Parameters of the check for cameras that are no longer where they were calibrated."""

    active: bool = param(
        True,
        doc="Compare each camera with its own past while people walk, and name cameras that were turned or "
        "zoomed.",
    )
    repair: bool = param(
        False,
        doc="Correct the pose or the focal length of a named camera in the rig that is used from then on.",
    )
    turn_deg: float = param(
        0.1,
        unit="deg",
        ge=0.02,
        le=5.0,
        doc="Smallest change of a camera's rotation that is reported.",
    )
    zoom: float = param(
        0.005,
        ge=0.001,
        le=0.5,
        doc="Smallest relative change of a camera's focal length that is reported.",
    )
    memory_s: float = param(
        120.0,
        unit="s",
        ge=10.0,
        le=3600.0,
        doc="Time of walking after which the weight of a camera's past falls to 1/e.",
    )
