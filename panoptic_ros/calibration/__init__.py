"""Calibrate cameras from targets of known shape, in one bundle adjustment (Panoptic Studio, section 3.4).

Unknowns: the intrinsics, pose and clock offset of each camera, and a pose of the target at each instant. A
target is a set of points with known coordinates: a board, a wand, or one point without known coordinates.
Intrinsics have priors. Views have a time shift of their own, because hosts of webcams stamp late.

The covariance is that of the linearised problem, in the frame of the first camera.
"""
