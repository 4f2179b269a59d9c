"""Studies of patches: points on the body surface that are tracked by optical flow."""
