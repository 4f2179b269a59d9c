"""Consensus: association of 2D people over views, and a first estimate of their positions.

Voting and assembly share it: voting explains score maps away where people are known, and assembly solves
their joints. Association is in two steps (`grouping`, `newcomers`): 2D people are assigned to the people
predicted from the instant before (`guidance`), best agreement first; then new people are found where pairs
of 2D people agree and further views support them. Agreement is a Gaussian of distances in metres
(`agreement`), so no threshold depends on a camera's resolution.

In: a `DetectionSet`, flattened and undistorted (`evidence.gather`). Out: a `Grouping` and first positions.
Limits: a person needs 2D people in two views.
"""
