"""Group the views of single cameras into one set per instant of the master time line.

Input: ViewDetections, ClockModels of any number of clocks, and EndOfStream in replay. Output: DetectionSets
in time order. The order of arrival between cameras does not matter.

1. Live: leave out and name a camera whose clock disagrees with the majority (`agreement`, `majority`).
2. In recordings, and for cameras with clock models: drop frames with outlier timestamps, which are seconds
   off those before and after (`outliers`).
3. Convert timestamps to master time with the clock model of the camera, if there is one
   (`stamps.correction`). If frames show that the clock may have jumped, they wait for a model that covers the
   jump.
4. Choose the instants: those of the fastest camera, of a selected camera, or of a fixed grid (`instants`).
   They are predicted and updated with the frames of the master camera. They continue if the master camera
   drops frames.
5. Take from each camera the frame nearest to the instant, within 0.6 periods, and each frame at most once
   (`queue`). For example, 25 fps beside 29.97 fps gives 29.97 sets/s, with the slow camera in five of six.
6. Keep the timestamps of the views, or interpolate the 2D poses to the instant (`resample`).
7. If the clock of all cameras is set back, set times continue to increase (`jumps`).
8. In recordings, leave out cameras from another time (`overlap`, `far_views`).

Live, a set is closed at its deadline in capture time, and late frames are counted. Limits: without a clock
model, a single camera whose clock jumps is left out and not corrected. A constant timestamp error below 1 s
is not observable here.
"""

from panoptic_ros.sync.config import SyncConfig
from panoptic_ros.sync.stage import SyncStage

__all__ = ["SyncConfig", "SyncStage"]
