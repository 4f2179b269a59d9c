"""Association: groups 2D poses of several views into people, and continues people of the previous instant.

The 2D poses of an instant are flattened and undistorted once for all later stages. Association has two steps
(`grouping`). First, 2D poses are assigned to tracked people at their predicted positions, best agreement
first. Then new people are found where pairs of 2D poses agree and further views support them. Agreement is a
Gaussian of distances in metres, so no threshold depends on the resolution of a camera.

Input: `DetectionSet`, and the `TrackSet` that tracking feeds back. Output: `AssociationSet`. Limits: a new
person needs 2D poses in two views, a tracked person in `guided_views` (default one).
"""
