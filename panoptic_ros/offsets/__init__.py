"""Offsets: the clocks of cameras from the motion that they see.

Where people move, the rays of a joint meet only if the clocks of the cameras are right. In: the 2D people of
every camera frame at its own stamp, and tracked 3D people to tell who is who. Out: per camera an offset and a
drift with standard deviations, as `ClockModel`s. Works where stamps carry constant latencies of tens of
milliseconds, and needs neither timecode nor calibration of the latencies.

How (after Elhayek et al. 2012, which aligns cameras by motion models that all of them share): every joint
of every person is a cubic B-spline in time with a penalty on acceleration, learnt per joint; rays are linear
rows at stamp + offset with Cauchy weights; trajectories are eliminated (Schur complement of a banded system);
the clocks take Gauss-Newton steps with the marginal likelihood's term, without which noise in the velocities
pulls them, and Anderson's acceleration.

Limits: what all cameras share cannot be seen: offsets have mean 0 unless most cameras agree or one is
trusted. A bias of the detector along the motion looks like an offset (25 mm at 1 m/s: 25 ms); it is estimated
from what clocks cannot explain, and stands in the deviations. Where nothing moves nothing is known, which is
said. Calibration errors are not separated from clocks.
"""
from panoptic_ros.offsets.clocks import CameraClocks
from panoptic_ros.offsets.passes import Corrected, clocks_from_motion, correct_from_motion
from panoptic_ros.offsets.regroup import regroup

__all__ = ["CameraClocks", "Corrected", "clocks_from_motion", "correct_from_motion", "regroup"]
