"""Targets from the data of an instant, weighted by standard deviations or as in the paper.

`NoiseLevel` learns the size of the errors of one person's 2D joints, relative to the assumed size. Detectors
and images differ, so one `joint_sd` does not fit all. The level comes from the residuals of the solved pose.
Outliers hardly affect the median of their squares. The residuals are slightly too small, because the pose
absorbs some of the errors.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence

import numpy as np

from panoptic_ros.domain import Rig
from panoptic_ros.domain.segments import SegmentedBody
from panoptic_ros.domain.subjects import Subject
from panoptic_ros.geometry.chain import Pose, place_all
from panoptic_ros.geometry.segment_chain import Chain
from panoptic_ros.kinematics.body.sight import People, known_joints, seen_joints
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.pose.prior import PoseStatistics, PriorCosts, hinges_of
from panoptic_ros.kinematics.pose.targets import (
    NO_POINTS,
    NO_TURNS,
    NO_VIEWS,
    FloorPoints,
    OrientationTargets,
    PointTargets,
    PoseEvidence,
    ViewTargets,
)

Array = np.ndarray

MEDIAN_SQUARE = 2.0 * math.log(2.0)  # median of the squared length of a 2D residual with variance 1 per axis
FEWEST_RESIDUALS = 20  # minimum number of residuals for an update
# s between updates of the level; s, averaging time; weight of the assumed level, in updates
LOOK_S, MEMORY_S, BELIEF = 0.1, 1.0, 1
LEAST_LEVEL, MOST_LEVEL = 0.25, 4.0  # limits of the level, as fractions of the assumed standard deviation
NEAREST_RESIDUAL = 0.1  # m, minimum depth in front of a camera
PAPER_WIDTH = 656  # px, width of the images for which the paper's weights hold
PAPER = {"position": 1e-3, "orientation": 1.0, "projection": 0.7, "deviation": 0.06, "floor": 10.0}
PAPER_RADIUS = 0.05  # m
FLOOR_SD = 0.02  # m
NEAREST = 0.3  # m, minimum depth in front of a camera
UNMEASURED_SD = 0.025  # m, common error in all views of a joint whose offset was not measured on the person
OFFSET_SD = 0.01  # m, per axis, between a joint of the detector and the same joint of the body


class NoiseLevel:
    """Level of one person's residuals; 1 = as assumed."""

    def __init__(self) -> None:
        self._square = 1.0
        self._looks = 0
        self._since = LOOK_S

    @property
    def level(self) -> float:
        """Return the standard deviation of 2D joints as a fraction of the assumed one."""
        return min(max(math.sqrt(self._square), LEAST_LEVEL), MOST_LEVEL)

    def learn(self, views: ViewTargets, chain: Chain, pose: Pose, seconds: float) -> None:
        """Update the level from the residuals of a pose, at most once per LOOK_S.

        Args:
            views: Targets, weighted by the current level.
            seconds: s since the previous pose.
        """
        self._since += seconds
        if len(views.segments) < FEWEST_RESIDUALS or self._since < LOOK_S:
            return
        places, frames = place_all(chain, pose.root[None], pose.turns[None])
        sites = places[0, views.segments] + (frames[0, views.segments] @ views.offsets[..., None])[..., 0]
        turned = (views.rotations[views.cameras] @ sites[..., None])[..., 0]
        local = turned + views.translations[views.cameras]
        apart = local[:, :2] / np.maximum(local[:, 2:], NEAREST_RESIDUAL) - views.points
        square = float(np.median(views.weights * (apart**2).sum(axis=-1))) / MEDIAN_SQUARE * self.level**2
        self._looks += 1
        self._square += (square - self._square) * max(1.0 / (self._looks + BELIEF), LOOK_S / MEMORY_S)
        self._since = 0.0


class EvidenceBuilder:
    """Builder of the evidence for one subject.

    Args:
        joint_names: Names (K) of the joints in the detections.
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
        model, keypoints = subject.body.model, subject.body.seen
        self._columns = np.array([k for k, name in enumerate(joint_names) if name in keypoints], np.int64)
        self._names = [joint_names[k] for k in self._columns]
        known = [keypoints[name] for name in self._names]
        self._segments = np.array([segment for segment, _ in known], np.int64)
        self._offsets = np.array([offset for _, offset in known]).reshape(-1, 3)
        self._unmeasured = np.array([name not in subject.body.own for name in self._names])
        joints = subject.body.keypoints
        self._anchors = np.array([joints[name][0] for name in self._names], np.int64)
        cameras = rig.cameras if rig is not None else ()
        self.rotations = np.array([c.cam_from_world.rotation for c in cameras]).reshape(-1, 3, 3)
        self.translations = np.array([c.cam_from_world.translation for c in cameras]).reshape(-1, 3)
        focal = [c.intrinsics.matrix[0, 0] * PAPER_WIDTH / c.image_size[0] for c in cameras]
        self._paper_focal = np.array(focal)
        paper = config.paper_weights
        scale = config.prior_scale**2
        ours = PriorCosts(
            1.0,
            scale,
            config.deviation_sd**-2,
            scale,
            math.radians(config.limit_sd) ** -2,
            math.radians(config.prior_sd),
        )
        self.prior = statistics.prior(
            model.lower,
            model.upper,
            PriorCosts(PAPER["projection"], 1.0, PAPER["deviation"], 1.0, 0.0) if paper else ours,
        )
        if not paper:
            self.prior = self.prior._replace(hinges=hinges_of(model, math.radians(config.hinge_sd)))
        ground = np.array([model.index(name) for name in model.ground], np.int64)
        self.floor = (
            FloorPoints(ground, PAPER_RADIUS, PAPER["floor"])
            if paper
            else FloorPoints(ground, 0.0, FLOOR_SD**-2)
        )

    @property
    def sites(self) -> tuple[Array, Array, Array]:
        """Return the detection columns (N,) in use, their segments (N,) and offsets (N, 3) m."""
        return self._columns, self._segments, self._offsets

    def with_body(self, body: SegmentedBody) -> EvidenceBuilder:
        """Return a copy for the same subject with other lengths."""
        seen = body.seen
        found = copy.copy(self)
        found._offsets = np.array([seen[name][1] for name in self._names]).reshape(-1, 3)
        return found

    def views(self, people: People, root: Array, level: float = 1.0) -> ViewTargets:
        """Return the view targets of one person.

        Args:
            people: Points (K, 2) on the normalised image plane and scores (K,) by camera.
            root: (3,) m, approximate position of the person.
            level: Level of the errors of joints, as a fraction of the assumed one.
        """
        if not people:
            return NO_VIEWS
        cameras = np.array(sorted(people), np.int64)
        depth = self.rotations[cameras, 2] @ root + self.translations[cameras, 2]
        config = self._config
        if config.paper_weights:
            factors, power = PAPER["position"] * self._paper_focal[cameras] ** 2, 1.0
        else:
            factors, power = (np.maximum(depth, NEAREST) / (level * config.joint_sd)) ** 2, config.score_power
        points = np.array([people[camera][0] for camera in cameras.tolist()])
        scores = np.array([people[camera][1] for camera in cameras.tolist()])
        sites, views, seen, weights = seen_joints(points, scores, self._columns, factors, power)
        if not config.paper_weights and self._unmeasured.any():
            own = weights / np.maximum(depth, NEAREST)[views] ** 2  # 1/m^2
            others = np.bincount(sites, own, len(self._columns))[sites] - own
            weights = weights / (1.0 + UNMEASURED_SD**2 * self._unmeasured[sites] * others)
        scale = 1.0 if config.paper_weights else config.joint_scale**2
        return ViewTargets(
            self._segments[sites],
            self._offsets[sites],
            cameras[views],
            seen,
            weights,
            scale,
            self.rotations,
            self.translations,
            self._anchors[sites],
        )

    def points(self, joints: tuple[Array, Array] | None) -> PointTargets:
        """Return the targets of 3D joints.

        Args:
            joints: Positions (K, 3) m, NaN = missing, and covariances (K, 3, 3) m^2.
        """
        if joints is None:
            return NO_POINTS
        known, goals, spreads = known_joints(self._columns, *joints, OFFSET_SD**2)
        return PointTargets(
            self._segments[known],
            self._offsets[known],
            goals,
            np.linalg.inv(spreads),
            self._config.joint_scale**2,
            self._anchors[known],
        )

    def turns(self, segments: Array, goals: Array, spreads: Array) -> OrientationTargets:
        """Return the targets of orientations.

        Args:
            segments, goals, spreads: (N,), (N, 3, 3) and (N,) rad, standard deviations.
        """
        if not len(segments):
            return NO_TURNS
        weights = (
            np.full(len(segments), PAPER["orientation"]) if self._config.paper_weights else 4.0 / spreads**2
        )
        return OrientationTargets(segments, np.ascontiguousarray(goals), weights, 0.0)

    def evidence(
        self, views: ViewTargets, turns: OrientationTargets, points: PointTargets = NO_POINTS
    ) -> PoseEvidence:
        """Return all evidence of an instant."""
        return PoseEvidence(views, points, turns, self.floor, self.prior, 1.0)
