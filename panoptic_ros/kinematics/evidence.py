"""From data of an instant to targets, weighed as standard deviations or as in the paper."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from panoptic_ros.domain import Rig
from panoptic_ros.domain.subjects import Subject, ViewPeople
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.prior import PoseStatistics, PriorCosts
from panoptic_ros.kinematics.targets import (
    NO_POINTS,
    NO_TURNS,
    NO_VIEWS,
    Evidence,
    Floor,
    TurnTargets,
    ViewTargets,
)

Array = np.ndarray
PAPER_WIDTH = 656  # px, of the images that the paper's weights are for
PAPER = {"position": 1e-3, "orientation": 1.0, "projection": 0.7, "deviation": 0.06, "floor": 10.0}
PAPER_RADIUS = 0.05  # m
FLOOR_SD = 0.02  # m


class Weighing:
    """Makes the evidence for one subject.

    Args:
        joint_names: (K) of the detections.
    """

    def __init__(
        self,
        config: KinematicsConfig,
        subject: Subject,
        statistics: PoseStatistics,
        rig: Rig | None,
        joint_names: Sequence[str],
    ):
        self._config, self._subject = config, subject
        model, keypoints = subject.body.model, subject.body.keypoints
        self._columns = np.array([k for k, name in enumerate(joint_names) if name in keypoints], np.int64)
        known = [keypoints[joint_names[k]] for k in self._columns]
        self._segments = np.array([segment for segment, _ in known], np.int64)
        self._offsets = np.array([offset for _, offset in known]).reshape(-1, 3)
        cameras = rig.cameras if rig is not None else ()
        self.rotations = np.array([c.cam_from_world.rotation for c in cameras]).reshape(-1, 3, 3)
        self.translations = np.array([c.cam_from_world.translation for c in cameras]).reshape(-1, 3)
        focal = [c.intrinsics.matrix[0, 0] * PAPER_WIDTH / c.image_size[0] for c in cameras]
        self._paper_focal = np.array(focal)
        paper = config.paper_weights
        axis = math.radians(config.prior_sd)
        scale = config.prior_scale**2
        ours = PriorCosts(
            axis**-2, scale, config.deviation_sd**-2, scale, math.radians(config.limit_sd) ** -2
        )
        self.prior = statistics.prior(
            model.lower, model.upper,
            PriorCosts(PAPER["projection"], 1.0, PAPER["deviation"], 1.0, 0.0) if paper else ours,
        )  # fmt: skip
        ground = np.array([model.index(name) for name in model.ground], np.int64)
        self.floor = (
            Floor(ground, PAPER_RADIUS, PAPER["floor"]) if paper else Floor(ground, 0.0, FLOOR_SD**-2)
        )

    @property
    def sites(self) -> tuple[Array, Array, Array]:
        """Columns of the detections that are used, their segments and offsets m."""
        return self._columns, self._segments, self._offsets

    def views(self, people: dict[int, tuple[Array, Array]], root: Array) -> ViewTargets:
        """Targets of the views of one person.

        Args:
            people: points (K, 2) on the plane and scores (K,) by camera. root: (3,) m, about where it is.
        """
        if not people:
            return NO_VIEWS
        rows = []
        for camera, (points, scores) in sorted(people.items()):
            mine, score = points[self._columns], scores[self._columns]
            seen = np.flatnonzero((score > 0.0) & np.isfinite(mine).all(-1))
            depth = max(float(self.rotations[camera, 2] @ root + self.translations[camera, 2]), 0.3)
            if self._config.paper_weights:
                weight = PAPER["position"] * self._paper_focal[camera] ** 2 * score
            else:
                weight = (depth / self._config.joint_sd) ** 2 * score**self._config.score_power
            rows.append((seen, np.full(len(seen), camera, np.int64), mine[seen], weight[seen]))
        sites = np.concatenate([row[0] for row in rows])
        scale = 1.0 if self._config.paper_weights else self._config.joint_scale**2
        return ViewTargets(
            self._segments[sites], self._offsets[sites], np.concatenate([row[1] for row in rows]),
            np.ascontiguousarray(np.concatenate([row[2] for row in rows])),
            np.concatenate([row[3] for row in rows]), scale, self.rotations, self.translations,
        )  # fmt: skip

    def turns(self, segments: Array, goals: Array, spreads: Array) -> TurnTargets:
        """Targets of orientations: segments (N,), goals (N, 3, 3), standard deviations (N,) rad."""
        if not len(segments):
            return NO_TURNS
        weights = (
            np.full(len(segments), PAPER["orientation"]) if self._config.paper_weights else 4.0 / spreads**2
        )
        return TurnTargets(segments, np.ascontiguousarray(goals), weights, 0.0)

    def evidence(self, views: ViewTargets, turns: TurnTargets, weight: float = 1.0) -> Evidence:
        """All of an instant."""
        return Evidence(views, NO_POINTS, turns, self.floor, self.prior, weight)


def nearest_person(people: ViewPeople, expected: Array, depth: float, columns: Array) -> tuple[int, float]:
    """Index of the 2D person nearest to where the joints are expected, and how far off it is, m.

    Args:
        expected: (N, 2) on the plane, of the joints in `columns` (N,). depth: m.
    """
    best, least = -1, math.inf
    for k in range(len(people.points)):
        apart = np.linalg.norm(people.points[k, columns] - expected, axis=-1)
        apart = apart[np.isfinite(apart)]
        if len(apart) >= 3:
            far = float(np.median(apart)) * depth
            if far < least:
                best, least = k, far
    return best, least
