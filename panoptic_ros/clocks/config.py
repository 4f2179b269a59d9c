"""Parameters of the clocks stage."""
from __future__ import annotations

from dataclasses import dataclass

from panoptic_ros.params import Config, param


@dataclass(frozen=True, kw_only=True)
class ClocksConfig(Config):
    """Clock models from timecode."""

    window_s: float = param(
        20.0, unit="s", ge=1.0, le=600.0,
        doc="Length of the readings' window; longer is more precise, shorter follows a warming crystal.",
    )  # fmt: skip
    least_span_s: float = param(
        1.0, unit="s", ge=0.1, le=60.0, doc="Span of readings from which on a model is given."
    )
    period_s: float = param(1.0, unit="s", ge=0.0, le=60.0, doc="Time between two models of a device.")
    jump_s: float = param(
        0.02, unit="s", ge=1e-4, le=10.0,
        doc="Distance from the line beyond which a reading is left out, or a jump if others agree with it.",
    )  # fmt: skip
    jump_words: int = param(
        3, ge=2, le=100, doc="Consecutive readings off the line, on a line of their own, that make a jump."
    )
