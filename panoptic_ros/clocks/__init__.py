"""From timecode to clocks: for every device a line that turns its stamps into master time.

In: the `TimecodeReading`s of any number of devices. Out: a `ClockModel` per device, renewed while
readings come. The master time line is the timecode's own: real time since its midnight, which is
the count of frames over the exact rate (labels are not seconds at 23.976 and 29.97 Hz), counted on
over midnight. Where the timecode itself jumps (a generator that is set anew), master time runs on.

How: a straight line through the readings of a sliding window by iteratively reweighted least squares
(Huber, then the inliers alone), or, where stamps are late by what their way took, the line under them
(`envelope`); with its covariance. A reading off the line is kept aside. When several agree, one of the three
things that tell time has jumped: label, stamp or count of samples. If labels alone jumped, master time is
corrected for all devices that hear the jump (`timeline`); otherwise the device's clock has, and a new line
begins, with the old one's drift as its prior (`device`). After the last reading a model is held over, and its
uncertainty grows. `stereo` aligns two timecodes on the channels of one recording without any clock (Joo et
al. 2017, 3.3); `frames` finds the clock of a camera from its frames' stamps alone.

Limits: a constant delay between a sample and its stamp is not visible (parameter `delays_ms`). A
tape that runs backwards gives no clock. Jumps below `jump_s`, or eight times the stamps' scatter, are not
seen.
"""
from panoptic_ros.clocks.config import ClocksConfig
from panoptic_ros.clocks.stage import ClocksStage

__all__ = ["ClocksConfig", "ClocksStage"]
