"""Studies of calibrations."""
