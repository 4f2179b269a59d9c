"""Parameters of the appearance stage."""

from __future__ import annotations

from dataclasses import dataclass

from panoptic_ros.params import Config, param


@dataclass(frozen=True, kw_only=True)
class AppearanceConfig(Config):
    """Parameters of the measurement of clothing colours."""

    fewest: int = param(
        6,
        ge=1,
        le=30,
        doc="Visible points of the torso or the legs that a measurement of their colour needs.",
    )
