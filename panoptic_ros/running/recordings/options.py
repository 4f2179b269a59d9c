"""How a live graph is recorded."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from panoptic_ros.io.bag_split import Split
from panoptic_ros.running.recordings.selection import Selection


@dataclass
class RecordOptions:
    """How to record.

    Args:
        duration_s: None = until it is asked to end. budget_gb: 0 = as much as there is room for.
        keep_free_gb: on the disk. rig: calibration that goes into the bag, where the graph has none.
        split: into several bags; None = one.
    """

    selection: Selection = field(default_factory=Selection)
    duration_s: float | None = None
    budget_gb: float = 0.0
    keep_free_gb: float = 1.0
    rig: Path | None = None
    split: Split | None = None
