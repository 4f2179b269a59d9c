"""Parameters of the offsets stage."""

from __future__ import annotations

from dataclasses import dataclass

from panoptic_ros.params import Config, param
from panoptic_ros.stamps.delays import named_delays


@dataclass(frozen=True, kw_only=True)
class OffsetsConfig(Config):
    """Parameters of the live estimation of camera clocks from motion."""

    active: bool = param(
        False,
        doc="Estimate the cameras' clock offsets from the motion of people, and let sync correct "
        "timestamps by them.",
        when="cameras are neither triggered together nor on one clock, and errors of their timestamps are "
        "unknown.",
    )
    block_s: float = param(
        2.0,
        unit="s",
        ge=0.5,
        le=30.0,
        doc="Length of a block of motion; each block gives one estimate and new clock models.",
    )
    memory_s: float = param(
        60.0,
        unit="s",
        ge=2.0,
        le=3600.0,
        doc="Time after which the weight of a measurement falls to 1/e. A longer time is more precise; a "
        "shorter one follows crystals.",
    )
    trusted_camera: str = param(
        "",
        doc="Camera whose timestamps are right; empty: most cameras are right if they agree, else offsets "
        "have mean 0.",
    )
    delays_ms: tuple[str, ...] = param(
        (),
        unit="ms",
        doc="Clock delays that are known already; the same as sync.delays_ms, which is the default. "
        "Offsets that are found are added to them.",
    )

    def __post_init__(self) -> None:
        Config.__post_init__(self)
        named_delays("OffsetsConfig.delays_ms", self.delays_ms)
