"""Studies of the fusion of 2D poses into skeletons."""
