"""From timecode to clocks: for every device a line that turns its stamps into master time.

In: the `TimecodeReading`s of any number of devices. Out: a `ClockModel` per device, renewed while
readings come. The master time line is the timecode's own: real time since its midnight, which is
the count of frames over the exact rate (labels are not seconds at 23.976 and 29.97 Hz), counted on
over midnight.

How: a straight line through the readings of a sliding window by iteratively reweighted least squares
(Huber, then the inliers alone), with its covariance. Readings far from the line are left out; when
several in a row agree with each other instead, the timecode or the device's clock has jumped and a
new line begins.

Limits: device stamps are taken as they are. A constant delay between a sample and its stamp is not
visible to this, and stamps that are sometimes late shift the line by their mean delay. A tape that
runs backwards gives no clock.
"""
from panoptic_ros.clocks.config import ClocksConfig
from panoptic_ros.clocks.stage import ClocksStage

__all__ = ["ClocksConfig", "ClocksStage"]
