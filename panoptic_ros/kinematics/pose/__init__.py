"""Solvers of one pose or of a time window of poses: weighted targets, normal equations, covariances."""
