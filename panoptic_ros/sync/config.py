"""Parameters of sync."""
from __future__ import annotations

from dataclasses import dataclass

from panoptic_ros.params import Config, param


@dataclass(frozen=True, kw_only=True)
class SyncConfig(Config):
    """How frames of different cameras are put together."""

    window_s: float = param(
        0.008, unit="s", ge=0.0, le=1.0,
        doc="Frames within this time after the earliest one belong to one set; "
        "half a frame period of the fastest camera is right (`run` sets it so).",
    )  # fmt: skip
    deadline_s: float = param(
        0.0, unit="s", ge=0.0, le=10.0,
        doc="Live: how long, in capture time, a set waits for its last cameras. "
        "0 waits for all of them, however long (replay).",
    )  # fmt: skip
    minimum_views: int = param(
        1, ge=1, le=1000, doc="Sets of fewer views are dropped, and counted as sync.few_views."
    )
    queue_limit: int = param(
        512, ge=2, le=100000,
        doc="Most frames that wait per camera; beyond it the oldest are dropped and counted.",
    )  # fmt: skip
