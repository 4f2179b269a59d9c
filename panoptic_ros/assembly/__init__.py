"""Assembly: from 2D people and 3D proposals to the skeletons of one instant, without identity.

Joo et al. 2017, 5.3: skeletons are put together, each 2D detection supports a single one, and joints
are refined by minimising the reprojection error. There are two methods:

* `dynamic_programming`: the paper's; 3D parts of a `ProposalSet` are joined along the tree
  (`skeletal_proposals`, which is all of it).
* `consensus` (default): the people of the association, whose 2D people agree over views. People whom only
  the score maps show are added from voted nodes that nobody explains. The rest of this text is about it.

The final solve chooses the observations of each joint by truncated cost, exchanges left and right of
whole limbs where the images ask for it, refines with Cauchy weights, and states a covariance. The
noise of 2D joints is learnt online from residuals. Guidance enters choices only; positions are functions
of this instant's images, but those of people whom one or two views show (`few_views`).

In: `ProposalSet` (its `detections` suffice). Out: one `PoseSet` for each. Limits: people need two
views; biases of a detector are not seen by residuals (a `bias_table` takes known ones out, and
`refinement.bias_floor` states what is left).
"""
