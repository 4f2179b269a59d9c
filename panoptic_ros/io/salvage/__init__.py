"""Recover messages from bags that were cut by a kill, a full disk or an unplugged drive."""

from panoptic_ros.io.salvage.repair import RepairResult, repair

__all__ = ["RepairResult", "repair"]
