"""Calibrate cameras with known intrinsics from walking people, without a target.

Each joint at one instant is a target of one point without known coordinates. Tracklets link people over time
in each camera. Essential matrices pair the people of two cameras. The bundle adjustment of boards solves the
rest.
"""
