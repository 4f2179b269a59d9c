"""The moving body: poses of a skeleton of segments from any mix of cameras and IMUs (Malleson et al.
2020)."""
