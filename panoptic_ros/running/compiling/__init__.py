"""Ahead-of-time compilation of all kernels and modules."""
