"""Voting: from 2D score maps of many views to 3D node proposals and scored parts.

The method is Joo et al. 2017, "Panoptic Studio", sections 5.1 and 5.2. The vote of a 4 cm voxel is the mean
score of the maps at its centre, over the cameras that see it (eq. 1). Local maxima above a threshold are node
proposals. With `parts`, two proposals that may form a bone get a score: the mean over the views of how well
one 2D pose explains both ends.

Input: `AssociationSet`. Output: `ProposalSet`, which includes the association and its detections. If no view
has score maps, there are no nodes: they would add nothing to the 2D poses. `without_maps` computes them all
the same; a joint without maps then has a Gaussian round its 2D position.

Three methods find the maxima. `exact` finds all maxima in a working volume. It skips boxes that the rays of
too few views touch, and computes the vote of every voxel in the others. `seeds` (the default) starts where
viewing rays of 2D peaks meet. A soft vote then moves each seed to the centre of the votes round it, with
sub-voxel resolution. `off` returns no nodes.

With `explain_away` (the default) `seeds` first uses the people of the association. Their joints are
predicted, or found for new people. Each joint moves to the centre of the votes round it and becomes a node.
Such a node explains nearby 2D peaks, which then give no seeds, if enough views support it. The remaining
peaks find people whom the 2D poses lack, and joints on which the views disagree. So voting costs little where
all people are known. `exact` never explains peaks away. Stages of one method:

    VotingStage(VotingConfig(), context)                                        # explaining away
    VotingStage(VotingConfig(method="seeds", explain_away=False), context)      # seeds alone
    VotingStage(VotingConfig(method="exact", threshold=0.1, min_views=3), context)

Limits: `seeds` misses a joint without a 2D peak in two of the paired views. A view sees its field of view up
to the limits of depth maps and known occluders. Occlusion of people by each other is not modelled.
"""
