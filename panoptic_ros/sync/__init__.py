"""Sync: from the views of single cameras to one set per instant.

First form, by capture stamps: the earliest frame that waits opens a window, and every camera's
first frame inside of it joins the set. In: ViewDetections (and EndOfStream in replay). Out:
DetectionSet, in the order of time, whatever the order of arrival between cameras. Each frame is
used at most once. Limits: cameras of different rates share a set only where their frames fall
into one window; clocks are taken as they are.
"""
from panoptic_ros.sync.config import SyncConfig
from panoptic_ros.sync.stage import SyncStage

__all__ = ["SyncConfig", "SyncStage"]
