"""Refinement: smooths the motion of tracked people with a fixed lag, weighted by covariances.

Each joint has a Kalman filter with position and velocity as its state and white acceleration as process
noise. Where the motion of the surface was measured, the state has a correlated acceleration as well
(`motion_model`). The update uses the full covariance of the measured position, and a Cauchy weight against
outliers. A fixed-lag smoother (Rauch, Tung, Striebel 1965) then uses the frames within the lag. All joints of
all people are processed together (`filter_bank`): people are rows of the same arrays (`records`).

If views have different timestamps, a position is measured together with its dependence on the velocity
(`domain.TimeShift`). So every view counts at its own timestamp.

Process noise, the scale of the covariances and the time correlation of errors are learnt online from
innovations (Mehra 1970, `tuning`). Where displacements of the surface were measured (`links`), their
innovations determine the process noise. Bone lengths are learnt online and act as soft constraints on the
joints (`bones`). Short gaps are interpolated or predicted, and their joints are marked as filled or
predicted. Detector errors that smoothing cannot remove are added to the covariances at the end
(`bias_floor`).

Input: `TrackedPoseSet`, and optionally `PatchTrajectories` and `BodyStateSet`. Output: one `RefinedPoseSet`
for each `TrackedPoseSet`, in order, delayed by the lag (`lag`); `flush` returns the remaining ones. Limits:
bones are rigid, and each joint is smoothed separately. Constant errors of a detector (biases) are not
corrected.
"""
