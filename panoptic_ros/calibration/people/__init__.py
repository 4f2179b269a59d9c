"""Calibrate cameras with known intrinsics from walking people, without a target.

Each joint at one instant is a target of one point without known coordinates. People are linked over time in each
camera, essential matrices pair the people of two cameras, and the bundle adjustment of boards solves the rest.
"""
