"""Refinement: motion of tracked people, smoothed over a short lag on its covariances.

Each joint has a Kalman filter (position and velocity, white acceleration). Its update uses the full
covariance of the measured position and a Cauchy weight against outliers. A fixed-lag smoother then uses
the frames that follow (Rauch, Tung, Striebel 1965). Every step is done once for all joints of all people
(`filter_bank`), who are rows of the same arrays (`records`). Where views have stamps of their own, positions
are measured together with the motion (`domain.TimeShift`), so that every view counts at its own stamp. The
velocity of new joints is estimated from all joints of a person together (`start_motion`).

Process noise, the scale of the covariances and the correlation of errors over time are learnt online from
innovations (Mehra 1970, `tuning`); where displacements were measured on the surface (`links`), process noise
from theirs. Bone lengths are learnt online and are soft constraints on the joints
(`bones`). Short gaps are interpolated or predicted, and their joints are marked as filled or predicted.
Errors of a detector that no smoothing removes are added to the covariances at the end (`bias_floor`).

In: `TrackedPoseSet`. Out: one `RefinedPoseSet` for each, in order, delayed by the lag (`lag`); `flush`
gives the rest. Limits: bones are rigid, and each joint is smoothed by itself. Errors that are constant
over time (biases of a detector) are not corrected.
"""
