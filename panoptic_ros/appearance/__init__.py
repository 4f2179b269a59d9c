"""Clothing colours, which distinguish people of the same size; measured in the process that has the images.

Input: `ViewFrame`, `ViewDetections`. Output: one `ViewAppearance` per image with people.
`identity.appearance` and tracking use it. Limits: two colours do not describe patterns, and people in the
same clothes look the same.
"""
