"""Tracking: skeletons of single instants become people with identity.

Joo et al. 2017 (5.3) give a skeleton the identity of the nearest one of the frame before, by the
distance of the head node, and look further back where it is missing. Made robust here: all joints
that two skeletons share take part, each against a constant-velocity prediction and its uncertainty;
the assignment is optimal per frame (Hungarian) instead of nearest; after a gap the middle of the
body and the lengths of the bones decide,
after longer ones `identity.likeness`; and a skeleton of few views must be seen repeatedly
before it gets an identity. `tracking.method=head` is the paper's way.

In: `PoseSet`, and `ViewAppearance` with `tracking.appearance`. Out: one `TrackedPoseSet` for each,
measured skeletons only, ids counting from 0 in the order of appearance and never used twice; and one
`TrackSet`, all who are followed with the motion of their joints as images show them, which goes back to
association. Limits: without appearance, people who change places unseen may change ids when their
bodies have the same size.
"""
