"""Estimate the clocks of cameras from the motion that they observe.

If people move, the rays of a joint intersect only if the camera clocks are right. Input: the 2D poses of
every camera frame at its own timestamp, and tracked 3D poses for the association. Output: an offset and a
drift per camera with standard deviations, as `ClockModel`s. The method works if timestamps have constant
latencies of tens of milliseconds. It needs neither timecode nor calibrated latencies.

The method follows Elhayek et al. 2012, who align cameras by common motion models. Every joint of every person
is a cubic B-spline in time with a penalty on acceleration. The penalty weight is learnt per joint. Rays are
linear rows at timestamp + offset, with Cauchy weights. Trajectories are eliminated (Schur complement of a
banded system). The clocks are updated by Gauss-Newton steps with Anderson acceleration. The steps include the
term of the marginal likelihood, without which velocity noise biases the clocks.

Limits:

* An offset common to all cameras is not observable. Offsets therefore have mean 0, unless most cameras agree
  or one is trusted.
* A detector bias along the motion looks like an offset (25 mm at 1 m/s: 25 ms). It is estimated from
  residuals that clocks cannot explain, and is part of the standard deviations.
* Without motion the clocks are unknown, and a notice reports it.
* Calibration errors are not separated from clock errors.
"""
