"""Scores of estimated skeletons against the truth, and their reports.

In: two `SkeletonSequence`s (truth and result). Out: a `Report` (`evaluate`), or the share of right
limbs under one of the two rules that the literature uses (`evaluate_pcp`). Pure functions.

How it is done: truth and result frames are paired by stamp, the truth is moved to the result's
instant (cubic spline per person), and people are assigned one to one by mean joint distance
(`pairing`). Everything else is counted on these pairs: position errors, PCK, joint recall and
precision (`joint_scores`), person recall and precision, identity switches, MOTA (Bernardin and
Stiefelhagen 2008), IDF1 (Ristani et al. 2016) (`identity_scores`), acceleration error and the
consistency of reported covariances (`motion_scores`). PCP follows Belagiannis et al. 2014 with
the head rules of VoxelPose and of 4D Association (`pcp`).

Limits: a person is matched anew in each frame; long exchanges of two people at the same place
show in the identity scores only. A result frame serves at most one truth frame.
"""

from panoptic_ros.evaluation.limits import Limit, failures, parse_limit
from panoptic_ros.evaluation.pairing import FramePair, pair_sequences
from panoptic_ros.evaluation.pcp import PCP_RULES, PcpReport, evaluate_pcp
from panoptic_ros.evaluation.report import Report, evaluate
from panoptic_ros.evaluation.sequences import SkeletonFrame, SkeletonSequence
from panoptic_ros.evaluation.tables import pcp_table, report_table
from panoptic_ros.evaluation.time_offset import TimeOffset, find_time_offset, shifted

__all__ = [
    "PCP_RULES",
    "FramePair",
    "Limit",
    "PcpReport",
    "Report",
    "SkeletonFrame",
    "SkeletonSequence",
    "TimeOffset",
    "evaluate",
    "evaluate_pcp",
    "failures",
    "find_time_offset",
    "pair_sequences",
    "parse_limit",
    "pcp_table",
    "report_table",
    "shifted",
]
