"""Joints of a skeleton, its tree of bones, and the detector joints that fill them."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from panoptic_ros.errors import ConfigError, DataError, shown


@dataclass(frozen=True, slots=True)
class SkeletonModel:
    """Joint names, a tree of bones, left-right pairs. Joints are indices into `joint_names`.

    Args:
        name: e.g. "panoptic19".
        joint_names: J names.
        root: Joint at the root of the tree.
        bones: J - 1 pairs (parent, child); a parent is listed before its children.
        head: Joint that represents the head (association over time, Joo et al. 2017, 5.3).
        left_right: Pairs (left, right).
        derived: (joint, sources): joints that the detector does not see, defined as the mean of others in 3D,
            e.g. BodyCenter = mean of the hips.
        bias_floors: m for each joint, standard deviation per axis of the detector's constant biases, which
            all views share; () = unknown. Not part of the identity (`hash`).

    Raises:
        ConfigError: if the bones are not a tree over all joints, a name repeats, or an index or floor is out
            of range.
    """

    name: str
    joint_names: tuple[str, ...]
    root: int
    bones: tuple[tuple[int, int], ...]
    head: int
    left_right: tuple[tuple[int, int], ...] = ()
    derived: tuple[tuple[int, tuple[int, ...]], ...] = ()
    bias_floors: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        count = len(self.joint_names)
        if len(set(self.joint_names)) != count:
            raise ConfigError(f"skeleton {self.name}: a joint name repeats")
        reached = {self.root}
        for parent, child in self.bones:
            if parent not in reached or child in reached or not 0 <= child < count:
                raise ConfigError(f"skeleton {self.name}: bone {parent}-{child} does not extend the tree")
            reached.add(child)
        if len(reached) != count:
            missing = [n for i, n in enumerate(self.joint_names) if i not in reached]
            raise ConfigError(f"skeleton {self.name}: no bone leads to {', '.join(missing)}")
        sides = [joint for pair in self.left_right for joint in pair]
        derived = [index for joint, sources in self.derived for index in (joint, *sources)]
        for index in (self.root, self.head, *sides, *derived):
            if not 0 <= index < count:
                raise ConfigError(f"skeleton {self.name} has {count} joints, none of index {index}")
        floors = self.bias_floors
        if len(floors) not in (0, count) or not all(0.0 <= f <= 1.0 for f in floors):
            raise ConfigError(f"skeleton {self.name}: bias_floors are 0 to 1 m, one for each joint")

    def __len__(self) -> int:
        return len(self.joint_names)

    def joint(self, name: str) -> int:
        """Return the index of a joint.

        Raises:
            ConfigError: if there is no joint of that name.
        """
        if name not in self.joint_names:
            raise ConfigError(f"skeleton {self.name} has no joint {shown(name)}")
        return self.joint_names.index(name)

    @property
    def parents(self) -> tuple[int, ...]:
        """Return the parent of every joint, -1 for the root."""
        table = [-1] * len(self.joint_names)
        for parent, child in self.bones:
            table[child] = parent
        return tuple(table)

    @property
    def mirror(self) -> tuple[int, ...]:
        """Return the opposite-side joint of every joint; joints in the middle map to themselves."""
        table = list(range(len(self.joint_names)))
        for left, right in self.left_right:
            table[left], table[right] = right, left
        return tuple(table)

    @property
    def hash(self) -> str:
        """Return eight hex digits that identify this model in messages."""
        text = repr((self.joint_names, self.root, self.bones, self.head, self.left_right, self.derived))
        return hashlib.sha256(text.encode()).hexdigest()[:8]


Array = np.ndarray


@dataclass(frozen=True, slots=True)
class JointMap:
    """Detector joints that each of J working joints is made from.

    Args:
        source_count: Number of joints of the detector.
        sources: J tuples. One index = copied. Several = their mean in the image (a start only: the final
            position of such a joint is derived in 3D). An empty tuple = never seen.
    """

    source_count: int
    sources: tuple[tuple[int, ...], ...]

    def apply(self, points: Array, scores: Array) -> tuple[Array, Array]:
        """Return points (P, J, 2) and scores (P, J) from the detector's (P, K, 2) and (P, K).

        A mean needs all of its sources and gets the lowest of their scores.

        Raises:
            DataError: if the detector has another number of joints.
        """
        if points.shape[1] != self.source_count:
            raise DataError(f"{points.shape[1]} joints from a detector of {self.source_count}")
        mapped = np.full((len(points), len(self.sources), 2), np.nan)
        mapped_scores = np.zeros(mapped.shape[:2])
        targets, taken, means = _plan(self.sources)
        mapped[:, targets], mapped_scores[:, targets] = points[:, taken], scores[:, taken]
        for joint, columns in means:
            mapped_scores[:, joint] = scores[:, columns].min(axis=1)
            mapped[:, joint] = points[:, columns].mean(axis=1)
        mapped[mapped_scores <= 0.0] = np.nan
        return mapped, mapped_scores


@lru_cache(maxsize=64)
def _plan(sources: tuple[tuple[int, ...], ...]) -> tuple[Array, Array, list[tuple[int, Array]]]:
    """Return the copied joints, their source joints, and the joints that are means with their sources."""
    alone = [(joint, own[0]) for joint, own in enumerate(sources) if len(own) == 1]
    means = [(joint, np.array(own)) for joint, own in enumerate(sources) if len(own) > 1]
    return np.array([a for a, _ in alone], int), np.array([b for _, b in alone], int), means
