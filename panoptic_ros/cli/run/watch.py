"""What a person sees while a run goes on: a progress bar, or the live table."""
from __future__ import annotations

from typing import Any

from panoptic_ros.cli.run.plan import Plan
from panoptic_ros.view.live_table import LiveTable
from panoptic_ros.view.progress import ProgressBar


class Watch:
    """Is shown every record of a run. A context manager that leaves the terminal in order.

    Args:
        table: the live table in place of the progress bar.
    """

    def __init__(self, plan: Plan, table: bool):
        self._table = LiveTable(plan.rig.names, plan.skeleton) if table else None
        self._bar = None if table else ProgressBar(None if plan.live else plan.instants, "skeletons")
        self._instants = 0

    def saw(self, key: str, record: Any) -> None:
        """A record of the topic of that key."""
        if key == "detections" and self._table is not None:
            self._table.saw_view(record.camera, len(record.person_scores))
        if key == "skeletons":
            self._instants += 1
            if self._table is not None:
                self._table.saw_poses(record)
            if self._bar is not None:
                self._bar.update(self._instants)

    def close(self) -> None:
        """Stop drawing."""
        if self._table is not None:
            self._table.close()
        if self._bar is not None:
            self._bar.close()
        self._table = self._bar = None

    def __enter__(self) -> Watch:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
