"""Sync: from the views of single cameras to one set per instant of the master time line.

In: ViewDetections, ClockModel of any number of clocks, and EndOfStream in replay. Out: DetectionSet, in the
order of time, whatever the order of arrival between cameras.

How: a frame whose stamp is seconds off those of its camera before and after is dropped (`strays`). Stamps are
moved to master time by the clock model of their camera (`correction`), where there is one; a
camera whose frames show that its clock may have jumped waits for a model that has heard so. Instants are
those of the fastest camera, of a chosen one, or a fixed grid (`instants`): they are predicted, follow the
master camera's frames, and go on where it drops some. Each camera gives the frame that is nearest, within
0.6 of a period, each frame at most once (`queue`); so 25 fps beside 29.97 fps gives 29.97 sets a second,
each slow camera in five of six. Views keep their own stamps, or are interpolated to the instant
(`resample`, `links`). Where clocks jump and no model tells, cameras are held against each other (`jumps`).

Live, a set is closed at its deadline in capture time; late frames are counted. Limits: without a clock
model, a single camera whose clock jumps is left out, not corrected; a constant error of stamps is not
visible here.
"""
from panoptic_ros.sync.config import SyncConfig
from panoptic_ros.sync.stage import SyncStage

__all__ = ["SyncConfig", "SyncStage"]
