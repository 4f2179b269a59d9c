"""Offsets: the clocks of cameras from the motion that they see.

Where people move, the rays of a joint meet only if the clocks of the cameras are right. In: the 2D people
of every camera frame at its own stamp, and tracked 3D people for the association. Out: per camera an offset
and a drift with standard deviations, as `ClockModel`s. The method works where stamps have constant
latencies of tens of milliseconds. It needs neither timecode nor calibrated latencies.

How (after Elhayek et al. 2012, who align cameras by motion models that all of them share): every joint of
every person is a cubic B-spline in time with a penalty on acceleration, whose weight is learnt per joint.
Rays are linear rows at stamp + offset with Cauchy weights. Trajectories are eliminated (Schur complement of
a banded system). The clocks take Gauss-Newton steps with the term of the marginal likelihood, without which
noise in the velocities biases them, and Anderson acceleration.

Limits: what all cameras share is not observable, so offsets have mean 0 unless most cameras agree or one is
trusted. A bias of the detector along the motion looks like an offset (25 mm at 1 m/s: 25 ms). It is estimated
from residuals that clocks cannot explain, and is part of the standard deviations. Where nothing moves nothing
is known, and a notice says so. Calibration errors are not separated from clocks.
"""

from panoptic_ros.offsets.clocks import CameraClocks
from panoptic_ros.offsets.passes import MotionClocks, MotionClocksConfig, clocks_from_motion
from panoptic_ros.offsets.regroup import regroup

__all__ = ["CameraClocks", "MotionClocks", "MotionClocksConfig", "clocks_from_motion", "regroup"]
