"""Calibration of cameras from recordings of a target."""
