"""Voting: 2D score maps of many views become 3D node proposals and scored parts.

Method: Joo et al. 2017, "Panoptic Studio", sections 5.1 and 5.2. Every 4 cm voxel gets the mean over the
cameras that see its centre of the score of their maps there (eq. 1); local maxima above a threshold are
node proposals. With `parts`, a pair of proposals that may be a bone is scored by the mean over the views of
how well one 2D person explains both ends.

In: `DetectionSet`. Out: `ProposalSet`, with the detections carried along. Where no view has score maps there
are no nodes: they would tell no more than the 2D people. `without_maps` asks for them all the same; a joint
without maps then has a Gaussian round its place in 2D.

`exact` finds all of these maxima in a working volume: boxes that the rays of too few views touch are skipped,
in all others every voxel is voted on. `seeds` (the default) begins where viewing rays of 2D peaks meet, and
moves below the voxel to the centre of the votes there, by a soft vote. `off` votes for none.

With `explain_away` (the default) `seeds` starts from people, where association believes their joints to be:
as they are predicted, or as newcomers were found. Each joint moves to the centre of the votes about it and is
a node. 2D peaks that such a node explains, in views that agree with it, give no seeds; what is left finds
people whom the lists of 2D people lack, and joints on which the views disagree. So voting costs little where
all is known. `exact` never explains anything away. Stages of one method:

    VotingStage(VotingConfig(), context)                                        # explaining away
    VotingStage(VotingConfig(method="seeds", explain_away=False), context)      # seeds alone
    VotingStage(VotingConfig(method="exact", threshold=0.1, min_views=3), context)

Limits: `seeds` finds no joint without a 2D peak in two of the views that are paired; a view sees its field
of view as far as depth maps and known occluders let it, people do not hide each other.
"""
