"""Association: which 2D people of several views are one person, and who that was an instant before.

The evidence of an instant, its 2D people flattened and undistorted, is gathered once for all stages that
follow. Association is in two steps (`grouping`): 2D people are assigned to those who are followed, where they
should be now, best agreement first; then new people are found where pairs of 2D people agree and further
views support them. Agreement is a Gaussian of distances in metres, so no threshold depends on a camera's
resolution.

In: `DetectionSet`, and the `TrackSet` that tracking feeds back. Out: `AssociationSet`. Limits: a person needs
2D people in two views.
"""
