"""What a person sees while a run goes on."""
from __future__ import annotations

from panoptic_ros.cli.run.plan import Plan
from panoptic_ros.domain import RefinedPoseSet


class Watch:
    """Progress, or the live table."""

    def __init__(self, plan: Plan, table: bool):
        self._count = 0
        self._plan = plan

    def skeletons(self, item: RefinedPoseSet) -> None:
        """One more instant has come out."""
        self._count += 1

    def close(self) -> None:
        """Stop drawing."""

    def __enter__(self) -> Watch:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
