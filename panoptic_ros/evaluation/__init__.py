"""Scores of estimated skeletons against the ground truth, and their reports.

Input: two `SkeletonSequence`s, truth and result. Output: a `Report` (`evaluate`), or the share of correct
limbs (PCP) under one of the two rules in the literature (`evaluate_pcp`). All functions are pure.

Method: truth and result frames are paired by timestamp. The truth is interpolated to the result's instant by
a cubic spline per person. People are assigned one to one by mean joint distance (`pairing`). All other scores
are computed on these pairs. `joint_scores` has position errors, PCK, joint recall and precision.
`identity_scores` has person recall and precision, identity switches, MOTA (Bernardin and Stiefelhagen 2008)
and IDF1 (Ristani et al. 2016). `motion_scores` has the acceleration error and the consistency of reported
covariances. PCP follows Belagiannis et al. 2014 with the head rules of VoxelPose and of 4D Association
(`pcp`).

Limits: people are matched independently in each frame, so a long exchange of two people at the same place
shows in the identity scores only. A result frame is paired with at most one truth frame.
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
