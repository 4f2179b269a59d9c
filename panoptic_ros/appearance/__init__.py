"""Colours of clothes, in the process that has the images: what tells people of the same size apart.

In: `ViewFrame`, `ViewDetections`. Out: one `ViewAppearance` for each image with people. What becomes of it is
in `identity.appearance` and tracking. Limits: two colours say nothing of patterns, and people who wear the
same look the same.
"""
