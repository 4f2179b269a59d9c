"""From timecode to clocks: for every device a line that turns its stamps into master time.

In: the `TimecodeReading`s of any number of devices. Out: a `ClockModel` per device, renewed while
readings come. The master time line is that of the timecode: real time since its midnight, which is the
count of frames over the exact rate (labels are not seconds at 23.976 and 29.97 Hz). It continues over
midnight. Where the timecode itself jumps (a generator that is set anew), master time runs on.

How: a straight line with its covariance is fitted to the readings of a sliding window by iteratively
reweighted least squares (Huber, then the inliers alone). If transport delays make stamps late, the lower
envelope of the points is taken instead (`envelope`). A reading off the line is an outlier and is kept aside.
When several outliers agree, one of three has jumped: label, stamp or count of samples. If only the labels
jumped, master time is corrected for all devices that hear the jump (`timeline`). Otherwise the clock of the
device has jumped, and a new line begins with the old drift as its prior (`device`). After the last reading a
model is held over, and its uncertainty grows. `stereo` aligns two timecodes on the channels of one recording
without any clock (Joo et al. 2017, 3.3). `frames` finds the clock of a camera from the stamps of its frames
alone.

Limits: a constant delay between a sample and its stamp is not visible (parameter `delays_ms`). A tape that
runs backwards gives no clock. Jumps below `jump_s`, or below eight times the scatter of the stamps, are not
detected.
"""

from panoptic_ros.clocks.config import ClocksConfig
from panoptic_ros.clocks.stage import ClocksStage

__all__ = ["ClocksConfig", "ClocksStage"]
