"""Refinement: motion of tracked people, smoothed over a short lag on its covariances.

Each joint has a Kalman filter (position and velocity, white acceleration) that takes the measured
position with its full covariance, discounts outliers with a Cauchy weight, and is smoothed back over
the frames that came after (Rauch, Tung, Striebel 1965). Where views have stamps of their own, positions
are measured together with the motion (`domain.TimeShift`), so that every view counts at its own stamp.
How fast joints are that are new is told by all joints of a person together (`start_motion`).
How abruptly people move, how honest the stated covariances are, and whether errors last from frame to
frame is learnt online from innovations (Mehra 1970). The lengths of a person's bones are learnt online
and pull the joints softly. Short gaps are filled from both sides or predicted, and say so. What lasts
of a detector's errors, which no smoothing removes, is stated in the covariances at the end.

In: `TrackedPoseSet`. Out: one `RefinedPoseSet` for each, in order, late by the lag (what that means is
told in `refinement/lag.py`); `flush` hands out the rest. Limits: bones are rigid, joints are smoothed one
by one; errors that stay the same over time (biases of a detector) are not touched.
"""
