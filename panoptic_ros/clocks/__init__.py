"""Estimate a clock model per device from timecode: a line that converts device timestamps to master time.

Input: the `TimecodeReading`s of any number of devices. Output: a `ClockModel` per device, updated while
readings arrive. The master time line is that of the timecode: real time since the timecode's midnight. It
equals the frame count divided by the exact rate, because labels are not seconds at 23.976 and 29.97 Hz.
Master time continues over midnight. It also continues where the timecode jumps, for example if a generator is
set again.

A line with its covariance is fitted to the readings of a sliding window. The fit is iteratively reweighted
least squares (Huber), followed by least squares on the inliers alone. If transport delays make timestamps
late, the lower envelope of the points is used instead (`envelope`). A reading off the line is an outlier and
is kept separately. If several outliers agree, the label, the timestamp or the sample count has jumped. If
only the labels jumped, master time is corrected for all devices that receive the jump (`timeline`). Otherwise
the device clock has jumped. A new line then begins, with the old drift as its prior (`device`). After the
last reading the model is held over, and its uncertainty grows. `stereo` aligns two timecodes on the channels
of one recording without any other clock (Joo et al. 2017, 3.3). `report` estimates the clock of a camera from
its frame timestamps alone.

Limits:

* A constant delay between a sample and its timestamp is not observable (parameter `delays_ms`).
* A tape that runs backwards gives no clock.
* Small jumps are not detected. The limit is eight times the timestamp scatter, but at most `jump_s`.
"""
