"""Sync: from the views of single cameras to one set per instant of the master time line.

In: ViewDetections, ClockModel of any number of clocks, and EndOfStream in replay. Out: DetectionSet, in the
order of time, whatever the order of arrival between cameras.

How: live, a camera whose clock disagrees with that of most cameras is left out and named (`agreement`,
`majority`). In recordings, and where clock models are used, a frame is dropped if its stamp is an outlier,
seconds off those of its camera before and after (`outliers`). The clock model of a camera, if there is one,
moves its stamps to master time (`correction`). If frames show that the clock of their camera may have jumped,
they wait for a model that knows of the jump.
Instants are those of the fastest camera, of a chosen one, or a fixed grid (`instants`). They are predicted,
updated by the frames of the master camera, and continue where it drops some. Each camera gives the frame
that is nearest, within 0.6 of a period, and each frame at most once (`queue`). So 25 fps beside 29.97 fps
gives 29.97 sets a second, with each slow camera in five of six. Views keep their own stamps, or are
interpolated to the instant (`resample`, `links`). If the clock of all cameras is set back, sets run on
(`jumps`). In recordings, cameras of another time are left out (`overlap`, `far_views`).

Live, a set is closed at its deadline in capture time, and late frames are counted. Limits: without a clock
model, a single camera whose clock jumps is left out, not corrected. A constant error of stamps below a second
is not visible here.
"""

from panoptic_ros.sync.config import SyncConfig
from panoptic_ros.sync.stage import SyncStage

__all__ = ["SyncConfig", "SyncStage"]
