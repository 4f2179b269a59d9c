"""The final solve: positions and covariances of all joints of all people of one instant."""
from __future__ import annotations

import numpy as np

from panoptic_ros.assembly.config import AssemblyConfig
from panoptic_ros.domain import Groups
from panoptic_ros.kernels import njit
from panoptic_ros.solving.gauss_newton import SolverRules
from panoptic_ros.solving.joint_records import Claims, Guides, SolvedJoints
from panoptic_ros.solving.joints import solve_again, solve_joints
from panoptic_ros.solving.scene import Scene

Array = np.ndarray


class Solver:
    """Solves joints, and assigns each 2D joint to one skeleton."""

    def __init__(self, config: AssemblyConfig):
        self._rules = SolverRules(
            config.truncation, config.cauchy, config.gate, config.foreign_penalty, config.max_pairs
        )

    def solve(self, scene: Scene, groups: Groups, source: Array, guides: Guides) -> SolvedJoints:
        """Positions of associated people.

        Args:
            source: (P, V, J) which joint of the 2D person stands for joint j.
        """
        claims = Claims(groups.member, source, np.full(scene.precision.shape, -1, np.int64))
        seen = scene.observations
        solved = solve_joints(guides, claims, seen, self._rules)
        losers = settle(solved, claims, self._rules.foreign_penalty)
        if losers.any():
            solve_again(losers, guides, claims, seen, self._rules, solved)
        return solved


def observed_views(scene: Scene, grouping: Groups, source: Array) -> Array:
    """(P, V, J) whether the 2D person of each view shows joint j."""
    if not len(scene.precision):
        return np.zeros(source.shape, bool)
    rows = np.maximum(grouping.member, 0)[..., None]
    usable: Array = (grouping.member >= 0)[..., None] & (scene.precision[rows, source] > 0.0)
    return usable


@njit(cache=True, error_model="numpy")
def settle(solved, claims, penalty):
    """Assign every 2D joint to the skeleton that it fits best, in `claims.owner`.

    The paper (5.3) demands that a 2D detection supports a single skeleton.

    Args:
        solved: `SolvedJoints`. claims: `Claims`. penalty: of foreign joints.

    Returns:
        (P, J) which joints lost a 2D joint.
    """
    residuals, picks, owner = solved.residuals, solved.picks, claims.owner
    people, joints, views = residuals.shape
    least = np.full(owner.shape, np.inf)
    for p in range(people):
        for j in range(joints):
            for v in range(views):
                if residuals[p, j, v] >= 0.0:
                    d, s = picks[p, j, v]
                    cost = residuals[p, j, v] ** 2 + (penalty if claims.member[p, v] != d else 0.0)
                    if cost < least[d, s]:
                        least[d, s], owner[d, s] = cost, p
    losers = np.zeros((people, joints), np.bool_)
    for p in range(people):
        for j in range(joints):
            for v in range(views):
                if residuals[p, j, v] >= 0.0 and owner[picks[p, j, v, 0], picks[p, j, v, 1]] != p:
                    losers[p, j] = True
    return losers
