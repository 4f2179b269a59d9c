"""Cost of a pose and its normal equations, without the Jacobian: see `segment_sums`."""

from __future__ import annotations

import numpy as np

from panoptic_ros.geometry.chain import Pose, place_segments
from panoptic_ros.geometry.segment_chain import Chain
from panoptic_ros.kernels import njit
from panoptic_ros.kinematics.pose.pose_terms import add_anchor, add_prior
from panoptic_ros.kinematics.pose.segment_sums import gather
from panoptic_ros.kinematics.pose.target_sums import add_floor, add_points, add_turns, add_views
from panoptic_ros.kinematics.pose.targets import Anchor, Evidence

Array = np.ndarray

_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def assemble(
    chain: Chain, pose: Pose, evidence: Evidence, anchor: Anchor, hessian: Array, gradient: Array
) -> float:
    """Cost of a pose; half of its second and first derivatives (D, D) and (D,) into the last two.

    Robust targets enter with the weight that their residuals leave them (Gauss-Newton).
    """
    count = len(chain.parents)
    frames, places = np.empty((count, 3, 3)), np.empty((count, 3))
    place_segments(chain, pose, frames, places)
    matrices, vectors = np.zeros((count, 6, 6)), np.zeros((count, 6))
    cost = add_views(evidence.views, frames, places, matrices, vectors)
    cost += add_points(evidence.points, frames, places, matrices, vectors)
    cost += add_turns(evidence.turns, frames, matrices, vectors)
    cost += add_floor(evidence.floor, places, matrices, vectors)
    gather(chain, frames, places, matrices, vectors, hessian, gradient)
    cost += add_prior(evidence.prior, pose, hessian, gradient)
    if evidence.weight != 1.0:
        cost *= evidence.weight
        hessian *= evidence.weight
        gradient *= evidence.weight
    return cost + add_anchor(anchor, pose, hessian, gradient)
