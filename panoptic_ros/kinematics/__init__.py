"""Poses of a skeleton of segments, from any combination of cameras and IMUs (Malleson et al. 2020)."""
