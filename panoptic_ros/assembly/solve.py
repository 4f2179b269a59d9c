"""The final solve: positions and covariances of all joints of all people of one instant."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.assembly.config import AssemblyConfig
from panoptic_ros.assembly.joint_solver import solve_again, solve_joints
from panoptic_ros.domain import Groups
from panoptic_ros.kernels import njit
from panoptic_ros.solving.agreement import limb_costs
from panoptic_ros.solving.gauss_newton import SolverRules
from panoptic_ros.solving.scene import Scene

Array = np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class Guide:
    """Predictions of P people, which are used in choices and never in positions.

    positions: (P, J, 3) m, NaN = none. spreads: (P, J) m, standard deviations. shifts: (P, J, 3) m/s,
    velocities. firm: (P, J) whether the position is certain enough to reject what two views say.
    """

    positions: Array
    spreads: Array
    shifts: Array
    firm: Array

    def rows(self, which: Array) -> Guide:
        """Some of the people."""
        return Guide(self.positions[which], self.spreads[which], self.shifts[which], self.firm[which])


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """Skeletons of one instant with what they rest on: P people, J joints, V views.

    positions: (P, J, 3) m, NaN = missing. normals: (P, J, 3, 3) 1/m^2, lower triangles.
    residuals: (P, J, V) in standard deviations, -1 = unused.
    picks: (P, J, V, 2) row of the evidence and joint of it, -1 = none.
    """

    positions: Array
    normals: Array
    residuals: Array
    picks: Array
    costs: Array

    @property
    def views(self) -> Array:
        """Number of views (P, J) behind each joint."""
        counts: Array = (self.residuals >= 0.0).sum(axis=-1)
        return counts


class Solver:
    """Solves joints, exchanges limbs, and assigns each 2D joint to one skeleton."""

    def __init__(self, config: AssemblyConfig, groups: Array, group_count: int):
        self._config, self._groups, self._group_count = config, groups, group_count
        self._rules = SolverRules(
            config.truncation, config.cauchy, config.gate, config.foreign_penalty, config.max_pairs
        )

    def solve(self, scene: Scene, grouping: Groups, source: Array, guide: Guide) -> Solved:
        """Positions of the people of a grouping.

        Args:
            source: (P, V, J) which joint of the 2D person stands for joint j; changed in place where
                a limb turns out to be exchanged.
        """
        owner = np.full(scene.precision.shape, -1, np.int64)
        todo = np.ones((len(grouping.member), len(scene.mirror)), bool)
        evidence = scene.evidence
        given = (
            guide.positions, guide.spreads, guide.shifts, guide.firm, grouping.member, source, owner,
            evidence.plane, scene.precision, evidence.starts, scene.cams, scene.centres, self._rules,
        )  # fmt: skip
        solved = Solved(*solve_joints(todo, *given))
        found = (solved.positions, solved.normals, solved.residuals, solved.picks, solved.costs)
        changed = self._exchange(scene, grouping, source, guide, solved)
        if changed.any():
            solve_again(changed, *given, *found)
        losers = settle(
            solved.residuals, solved.picks, owner, grouping.member, self._config.foreign_penalty
        )
        if losers.any():
            solve_again(losers, *given, *found)
        return solved

    def _exchange(
        self, scene: Scene, grouping: Groups, source: Array, guide: Guide, solved: Solved
    ) -> Array:
        """Exchange left and right of whole limbs where that is clearly cheaper.

        Returns:
            (P, J) whether a joint must be solved again.
        """
        if not self._group_count:
            return np.zeros(solved.costs.shape, bool)
        limit = self._config.truncation**2
        costs = limb_costs(
            solved.positions, guide.shifts, grouping.member, source, scene.evidence.plane, scene.precision,
            scene.cams, self._groups, scene.mirror, self._group_count, limit,
        )  # fmt: skip
        kept, swapped = costs[..., 0], costs[..., 1]
        better = (swapped + self._config.swap_gain < kept) & (swapped < 0.5 * kept)  # (P, V, G)
        touched = better[..., np.maximum(self._groups, 0)] & (self._groups >= 0)  # (P, V, J)
        source[:] = np.where(touched, scene.mirror[source], source)
        return np.ascontiguousarray(touched.any(axis=1))


def sources(mirrored: Array, mirror: Array) -> Array:
    """(P, V, J) which joint of each 2D person stands for joint j, from mirrored (P, V)."""
    return np.where(mirrored[..., None], mirror, np.arange(len(mirror))).astype(np.int64)


def observed_views(scene: Scene, grouping: Groups, source: Array) -> Array:
    """(P, V, J) whether the 2D person of each view shows joint j."""
    if not len(scene.precision):
        return np.zeros(source.shape, bool)
    rows = np.maximum(grouping.member, 0)[..., None]
    usable: Array = (grouping.member >= 0)[..., None] & (scene.precision[rows, source] > 0.0)
    return usable


@njit(cache=True, error_model="numpy")
def settle(residuals, picks, owner, member, penalty):
    """Assign every 2D joint to the skeleton that it fits best.

    The paper (5.3) demands that a 2D detection supports a single skeleton.

    Args:
        residuals (P, J, V), picks (P, J, V, 2): see `Solved`. member: (P, V). penalty: of foreign joints.
        owner: (D, J) the skeleton that has each 2D joint, in place.

    Returns:
        (P, J) which joints lost a 2D joint.
    """
    people, joints, views = residuals.shape
    least = np.full(owner.shape, np.inf)
    for p in range(people):
        for j in range(joints):
            for v in range(views):
                if residuals[p, j, v] >= 0.0:
                    d, s = picks[p, j, v]
                    cost = residuals[p, j, v] ** 2 + (penalty if member[p, v] != d else 0.0)
                    if cost < least[d, s]:
                        least[d, s], owner[d, s] = cost, p
    losers = np.zeros((people, joints), np.bool_)
    for p in range(people):
        for j in range(joints):
            for v in range(views):
                if residuals[p, j, v] >= 0.0 and owner[picks[p, j, v, 0], picks[p, j, v, 1]] != p:
                    losers[p, j] = True
    return losers
