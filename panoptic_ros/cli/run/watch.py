"""What a person sees while a run goes on: a progress bar, or the live table."""
from __future__ import annotations

import sys
import threading
import time
from collections.abc import Mapping
from typing import Any

from panoptic_ros.running.plan import Plan
from panoptic_ros.view.live_table import LiveTable
from panoptic_ros.view.progress import ProgressBar

PATIENCE_S = 10.0  # without a result after the first detections


class Watch:
    """Is shown every record of a run. A context manager that leaves the terminal in order.

    Args:
        table: the live table in place of the progress bar.
    """

    def __init__(self, plan: Plan, table: bool):
        self._table = LiveTable(plan.rig.names, plan.skeleton) if table else None
        self._bar = None if table else ProgressBar(None if plan.live else plan.instants, "skeletons")
        self._live = plan.live
        self._instants = 0
        self._waiting: threading.Timer | None = None

    def saw(self, key: str, record: Any) -> None:
        """A record of the topic of that key; of "diagnostics", what all nodes have counted."""
        if key == "detections" and self._waiting is None:
            self._waiting = threading.Timer(PATIENCE_S, _explain)
            self._waiting.daemon = True
            self._waiting.start()
        if key == "detections" and self._table is not None:
            self._table.saw_view(record.camera, len(record.person_scores))
        if key == "skeletons":
            self._stop_waiting()
            self._instants += 1
            if self._table is not None:
                self._table.saw_poses(record, self._latency_ms(record.stamp_ns))
            if self._bar is not None:
                self._bar.update(self._instants)
        if key == "diagnostics" and self._table is not None:
            self._table.set_dropped(dropped_in_all(record))

    def _latency_ms(self, stamp_ns: int) -> float | None:
        """Since exposure; recordings have stamps of their own, which say nothing about it."""
        return (time.time_ns() - stamp_ns) * 1e-6 if self._live else None

    def close(self) -> None:
        """Stop drawing."""
        self._stop_waiting()
        if self._table is not None:
            self._table.close()
        if self._bar is not None:
            self._bar.close()
        self._table = self._bar = None

    def _stop_waiting(self) -> None:
        if self._waiting is not None:
            self._waiting.cancel()

    def __enter__(self) -> Watch:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def _explain() -> None:
    """Tell a person who sees nothing happen why."""
    print(
        "\nwaiting for the first skeletons: kernels are compiled once after an installation, "
        "which takes about a minute", file=sys.stderr, flush=True,
    )  # fmt: skip


def dropped_in_all(counted: Mapping[str, Mapping[str, str]]) -> int:
    """Frames and messages that all nodes together have dropped."""
    return sum(
        int(number) for values in counted.values() for key, number in values.items()
        if key.startswith("dropped.")
    )  # fmt: skip
