"""Calibration from a projected or printed random pattern: structure from motion of cameras with known lenses.

The points of the pattern have no known coordinates. Points of several scenes enter one adjustment.
"""
