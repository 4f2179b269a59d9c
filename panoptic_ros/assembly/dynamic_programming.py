"""Skeletons from scored parts by dynamic programming, one after another (Joo et al. 2017, 5.3).

The best skeleton is the choice of one node per joint that maximises the sum of its part scores. With parts
that skip a joint, a joint may be missing. `lost_people` has such parts, the paper has none. The children of a
missing joint then hang on its parent, so that one missing joint does not cut off a limb. One of its children
replaces a missing root.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain import DetectionSet, ProposalSet, Rig, SkeletonModel

Array = np.ndarray
IMPOSSIBLE = -np.inf
SKIP_WEIGHT = 0.5  # weight of a part that skips a joint, relative to a bone
HEAD_VIEWS = 2  # minimum number of views in which a skeleton claims its head
VGA = (640, 480)  # px, image size for which the gate is stated


@dataclass(frozen=True, slots=True, eq=False)
class SkeletonHypothesis:
    """One skeleton before its joints are refined.

    Args:
        nodes: (J,) the node of each joint, -1 = missing.
        claims: (J, V) row of the 2D pose in each of the set's V views that supplies this joint, -1 = none. No
            2D joint is claimed twice.
    """

    nodes: Array
    claims: Array


def assemble(
    proposals: ProposalSet, rig: Rig, skeleton: SkeletonModel, gate_px: float
) -> list[SkeletonHypothesis]:
    """Return skeletons in the order of their scores, until no part remains.

    For each of its joints, a skeleton claims the nearest free 2D joint in every view. A skeleton whose head
    has fewer than `HEAD_VIEWS` claims is dropped, and claims nothing. There is no minimum score; 5.3
    gives the reason.

    Args:
        gate_px: Largest distance of a 2D joint from the projection of its node; see `Correspondence`.
    """
    tree = PartTree(proposals, skeleton, SKIP_WEIGHT)
    free = Correspondence(proposals.detections, rig, proposals.nodes, proposals.node_joints, gate_px)
    people: list[SkeletonHypothesis] = []
    while True:
        score, nodes = tree.best()
        if score <= 0.0:
            return people
        tree.remove(nodes[nodes >= 0])
        joints = np.flatnonzero(nodes >= 0)
        claims = np.full((len(nodes), len(proposals.detections.views)), -1, np.int64)
        claims[joints] = free.claims_of(nodes[joints])
        if (claims[skeleton.head] >= 0).sum() >= HEAD_VIEWS:
            free.claim(nodes[joints], claims[joints])
            people.append(SkeletonHypothesis(nodes, claims))


class PartTree:
    """Nodes and parts of one instant, as score matrices between the joints of the tree."""

    def __init__(self, proposals: ProposalSet, skeleton: SkeletonModel, skip_weight: float):
        self._root, self._parents = skeleton.root, skeleton.parents
        self._children: list[list[int]] = [[] for _ in skeleton.joint_names]
        for parent, child in skeleton.bones:
            self._children[parent].append(child)
        joints = proposals.node_joints
        self._nodes = [np.flatnonzero(joints == j) for j in range(len(skeleton))]
        self._pool = np.ones(len(joints), bool)
        self._free = [self._pool[mine] for mine in self._nodes]
        self._bones = list(skeleton.bones)
        self._scores = self._matrices(proposals, skip_weight)

    def _matrices(self, proposals: ProposalSet, skip_weight: float) -> dict[tuple[int, int], Array]:
        """Return score matrices (nodes of a, nodes of b) by pair of joints (a, b); `IMPOSSIBLE` = no part."""
        rank = np.zeros(len(proposals.nodes), np.int64)  # index of each node among those of its joint
        for nodes in self._nodes:
            rank[nodes] = np.arange(len(nodes))
        u, v = proposals.parts.T
        a, b = proposals.node_joints[u], proposals.node_joints[v]
        values = proposals.part_scores * np.where(proposals.part_bones >= 0, 1.0, skip_weight)
        matrices = {}
        key = a.astype(np.int64) * len(self._nodes) + b
        for pair in np.unique(key):
            first, second = divmod(int(pair), len(self._nodes))
            mine = (key == pair) & (values > 0.0)
            scores = np.full((len(self._nodes[first]), len(self._nodes[second])), IMPOSSIBLE)
            scores[rank[u[mine]], rank[v[mine]]] = values[mine]
            matrices[first, second] = scores
            matrices[second, first] = scores.T
        return matrices

    def remove(self, nodes: Array) -> None:
        """Remove nodes (K,) from the pool."""
        self._pool[nodes] = False
        self._free = [self._pool[mine] for mine in self._nodes]

    def best(self) -> tuple[float, Array]:
        """Return the score and the nodes (J,) of the best skeleton, -1 = missing.

        The score is 0 if there is no skeleton.
        """
        message: dict[tuple[int, int], tuple[Array, Array]] = {}
        below = [np.zeros(len(nodes)) for nodes in self._nodes]
        for parent, child in reversed(self._bones):
            for grandchild in self._children[child]:
                below[child] = below[child] + message[grandchild, child][0]
            above = self._parents[parent]
            if above >= 0:
                message[child, above] = self._send(child, above, below, [])
            skipped = [message[g, parent][0] for g in self._children[child]]
            message[child, parent] = self._send(child, parent, below, skipped)
        return self._pick(message, below)

    def _send(self, joint: int, to: int, below: list[Array], skipped: list[Array]) -> tuple[Array, Array]:
        """Return the best score of the branch that begins at a joint, for each node of the joint `to`.

        Args:
            joint: First joint of the branch.
            to: Joint on which the branch hangs.
            below: Best scores of the branches below each node of each joint.
            skipped: Scores per node of `to` if the joint is missing: one array for each branch that then
                hangs on `to`.

        Returns:
            scores: (nodes of `to`,).
            choices: (nodes of `to`,), chosen node of the joint, -1 = the joint is missing.
        """
        absent = np.zeros(len(self._nodes[to]))
        for scores in skipped:
            absent = absent + scores
        parts = self._scores.get((to, joint))
        if parts is None:
            return absent, np.full(len(absent), -1)
        gains = parts + np.where(self._free[joint], below[joint], IMPOSSIBLE)
        choice = gains.argmax(axis=1)
        present = gains[np.arange(len(gains)), choice]
        taken = (present >= absent) & (present > 0.0)
        return np.where(taken, present, absent), np.where(taken, choice, -1)

    def _pick(
        self, message: dict[tuple[int, int], tuple[Array, Array]], below: list[Array]
    ) -> tuple[float, Array]:
        """Return the score and the nodes of the best skeleton, from the messages of all branches.

        The top is the root or, if the root is missing, one of its children.
        """
        tops = self._children[self._root]
        best, top, place = 0.0, -1, -1
        for candidate in (self._root, *tops):
            hanging = tops if candidate == self._root else [t for t in tops if t != candidate]
            total = np.where(self._free[candidate], below[candidate], IMPOSSIBLE)
            for joint in hanging:
                if candidate != self._root:
                    message[joint, candidate] = self._send(joint, candidate, below, [])
                total = total + message[joint, candidate][0]
            if len(total) and total.max() > best:
                best, top, place = float(total.max()), candidate, int(total.argmax())
        nodes = np.full(len(self._nodes), -1, np.int64)
        if top < 0:
            return 0.0, nodes
        nodes[top] = self._nodes[top][place]
        hanging = self._children[top] + ([t for t in tops if t != top] if top != self._root else [])
        waiting = [(joint, top, place) for joint in hanging]
        while waiting:
            joint, on, at = waiting.pop()
            chosen = int(message[joint, on][1][at])
            if chosen >= 0:
                nodes[joint] = self._nodes[joint][chosen]
                waiting += [(child, joint, chosen) for child in self._children[joint]]
            elif on == self._parents[joint]:
                waiting += [(child, on, at) for child in self._children[joint]]
        return best, nodes


class Correspondence:
    """2D joints of one instant near its 3D nodes; each can be claimed once (one-to-one, 5.3).

    Args:
        nodes: (N, 3) m, world.
        joints: (N,) joint of each node.
        gate_px: Largest distance of a 2D joint from the projection of its node, in an image of 640 x 480. In
            other images it is the same share of the diagonal. The paper has 10 px in such images.
    """

    def __init__(self, detections: DetectionSet, rig: Rig, nodes: Array, joints: Array, gate_px: float):
        views = detections.views
        most = max((len(view.points) for view in views), default=0)
        count = max([int(joints.max(initial=-1)) + 1, *(view.points.shape[1] for view in views)])
        self._joints = np.asarray(joints, np.int64)
        self._free = np.zeros((count, len(views), most), bool)
        self._distances = np.full((len(nodes), len(views), most), np.inf)  # px, infinite beyond the gate
        for v, view in enumerate(views):
            known = view.scores > 0.0
            self._free[: known.shape[1], v, : len(known)] = known.T
            pixels, seen = rig.camera(view.camera).project(nodes)
            away = np.linalg.norm(view.points[:, self._joints].swapaxes(0, 1) - pixels[:, None], axis=-1)
            gate = gate_px * float(np.hypot(*view.image_size) / np.hypot(*VGA))
            near = seen[:, None] & known[:, self._joints].T & (away < gate)  # False for NaN
            self._distances[:, v, : len(known)] = np.where(near, away, np.inf)

    def claims_of(self, nodes: Array) -> Array:
        """Return the free 2D pose (K, V) whose joint is nearest to each of the nodes (K,); -1 = none near."""
        if self._free.shape[2] == 0:
            return np.full((len(nodes), self._free.shape[1]), -1, np.int64)
        distances = np.where(self._free[self._joints[nodes]], self._distances[nodes], np.inf)
        best = distances.argmin(axis=-1)
        return np.where(np.isfinite(distances.min(axis=-1)), best, -1)

    def claim(self, nodes: Array, claims: Array) -> None:
        """Claim the 2D joints (K, V) for these nodes (K,), so that no other skeleton can claim them."""
        row, view = np.nonzero(claims >= 0)
        self._free[self._joints[nodes[row]], view, claims[row, view]] = False
