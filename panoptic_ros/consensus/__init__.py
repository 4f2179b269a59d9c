"""Consensus: which 2D people of several views are one person, and roughly where it is.

Shared by voting, which explains score maps away where people are known, and by assembly, which solves
their joints. Rays of 2D people are compared in metres, so no threshold depends on a camera's resolution.
2D people are given to those known from the instant before, and new people are sought where pairs of
2D people agree and further views support them.

In: a `DetectionSet` (`evidence.gather`). Out: a `Grouping` and first positions. Limits: a person needs
2D people in two views.
"""
