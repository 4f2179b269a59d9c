"""Tracking: gives identities over time to the skeletons of single instants.

Joo et al. 2017 (5.3) give a skeleton the identity of the nearest skeleton of the previous frame, by the
distance of the head node. They search further back where the head is missing. The default method is more
robust:

* All common joints count, each compared with a constant-velocity prediction and its uncertainty.
* The assignment is optimal per frame (Hungarian) instead of nearest.
* After a gap, a person is recognised by position, bone lengths and clothes: at once within 2 s, later by the
  probabilities of `identity.likeness`.
* A skeleton of few views gets an identity only after it was seen repeatedly.

The parameter `tracking.method=head` selects the method of the paper.

Input: `PoseSet`, and `ViewAppearance` if `tracking.appearance` is set. Output per `PoseSet`: one
`TrackedPoseSet` and one `TrackSet`. The `TrackedPoseSet` holds measured skeletons only. Ids count from 0 in
the order of appearance, and no id is used twice. The `TrackSet` holds all tracks with the motion of their
joints, without bias corrections, and goes back to association. Limits: without appearance, people of the same
size may exchange ids if they change places unseen.
"""
