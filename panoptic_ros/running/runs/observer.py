"""How a run tells what goes on in it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.stage import Notice


class RunObserver:
    """Is told of the course of a run, in its own thread. This one takes no notice; derive what shows it."""

    def started(self, plan: Plan) -> None:
        """The plan is about to run."""

    def saw(self, key: str, record: Any) -> None:
        """A record of the topic of that key; of "diagnostics", what all nodes have counted."""

    def judged(self, notices: Sequence[Notice]) -> None:
        """The self-check of the calibration is done; while records come, or after the last."""

    def ended(self) -> None:
        """No more records come; what follows is the self-check, if it was not done, and the pictures."""

    def drew(self, done: int, total: int) -> None:
        """So many of the pictures are drawn."""
