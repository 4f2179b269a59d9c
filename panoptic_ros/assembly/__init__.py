"""Assembly: computes the skeletons of one instant from 2D poses and 3D proposals, without identities.

In Joo et al. 2017, 5.3, skeletons are assembled, each 2D joint supports only one skeleton, and joints are
refined by minimising the reprojection error. There are two methods:

* `dynamic_programming` is the method of the paper, in `skeletal_proposals`. It joins 3D parts of a
  `ProposalSet` along the tree of the skeleton.
* `consensus` (default) solves the people of the association, whose 2D poses agree over views. It adds people
  whom only the score maps show, from voted nodes that no known person explains. The text below describes this
  method.

The final solve chooses the observations of each joint by truncated cost, and minimises the reprojection error
with Cauchy weights. It uses the left and right sides that association decided, and reports how many views see
each limb with exchanged sides. Each joint has a covariance. The noise of 2D joints is learnt online from
residuals. Predictions influence choices only: positions depend on the images of this instant alone. Joints
that would be missing are the exception (`completion`).

Input: `ProposalSet`; its `detections` are sufficient. Output: one `PoseSet` for each. Limits: new people need
two views. Residuals do not show biases of a detector: a `bias_table` removes known ones, and
`refinement.bias_floor` states the remaining ones.
"""
