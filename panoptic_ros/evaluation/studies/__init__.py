"""Scores of the studies in Joo et al. 2017, 7.3: how accuracy depends on the number and kind of cameras.

In: frames of truth and result that are paired (`pair_sequences`). Out: `StudyScore`: the PCK curve over a
distance in metres (their Fig. 8), and the node and skeleton accuracy of their Table 3. Pure functions.

Other than in `joint_scores`, all joints of all true people count: a joint of a person whom nobody found
is wrong.
"""

from panoptic_ros.evaluation.studies.score import StudyScore, score_study

__all__ = ["StudyScore", "score_study"]
