"""Association of the 2D poses of several views with people, the tracks over time, and voting proposals.

The proposals are 3D nodes (putative joint positions) and parts with scores.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain.checks import (
    NOT_GIVEN,
    ShapeChecks,
    check_not_infinite,
    check_scores,
    check_stamp,
    own_copy,
)
from panoptic_ros.domain.detections import DetectionSet
from panoptic_ros.errors import DataError

Array = np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """All 2D poses of a set as flat arrays: V views in the order of the rig, D poses ordered by view.

    Args:
        cameras: (V,) index into the rig.
        slots: (V,) index into `DetectionSet.views`.
        starts: (V + 1,) first pose of each view.
        view: (D,) view of each pose.
        rows: (D,) index of the pose in its `ViewDetections`.
        plane: (D, J, 2) undistorted normalised points, 0 where missing.
        magnification: (D, J) image scale at the point, relative to the optical axis; 1 for Brown lenses of up
            to five terms.
        scores: (D, J), 0 where missing.
        delays: (V,) s, timestamp of the view minus that of the set; 0 where motion in between is neglected.

    Raises:
        DataError: if the arrays do not fit each other.
    """

    cameras: Array
    slots: Array
    starts: Array
    view: Array
    rows: Array
    plane: Array
    magnification: Array
    scores: Array
    delays: Array

    def __post_init__(self) -> None:
        views, people = len(self.cameras), len(self.view)
        shape = self.scores.shape
        _fit(self, "cameras slots delays", (views,))
        _fit(self, "starts", (views + 1,))
        _fit(self, "view rows", (people,))
        _fit(self, "scores magnification", (people, *shape[1:]))
        _fit(self, "plane", (people, *shape[1:], 2))

    @property
    def views(self) -> int:
        """Return the number of views."""
        return len(self.cameras)


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """Predicted joints of K tracked people at an instant.

    Args:
        positions: (K, J, 3) m, NaN = unknown.
        velocities: (K, J, 3) m/s, 0 where unknown.
        ages: (K, J) s since measured.
        variances: (K, J, 3) per axis: position variance, position-velocity covariance, velocity variance; see
            `identity.motion`.
        firm: (K, J) whether three or more views agreed on the joint recently (within
            `identity.motion.FIRM_TIME`).
        lengths: (K, B) m, learnt lengths of the skeleton's bones, NaN = unknown; (K, 0) = no lengths.

    Raises:
        DataError: if the arrays do not fit each other, or positions are infinite.
    """

    positions: Array
    velocities: Array
    ages: Array
    variances: Array
    firm: Array
    lengths: Array = NOT_GIVEN

    def __post_init__(self) -> None:
        shape = self.ages.shape
        _fit_lengths(self, shape[0])
        _fit(self, "positions velocities variances", (*shape, 3))
        _fit(self, "ages firm", shape)
        check_not_infinite(self, "positions velocities variances")

    @classmethod
    def of_nobody(cls, joints: int) -> Prediction:
        """Return a prediction without people."""
        places, numbers = np.zeros((0, joints, 3)), np.zeros((0, joints))
        return cls(places, places, numbers, places, numbers > 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Groups:
    """2D pose of each of P people in each of V views.

    Args:
        member: (P, V) row of the evidence, -1 = none.
        mirrored: (P, V) whether left and right of that 2D pose are exchanged.
    """

    member: Array
    mirrored: Array

    def __post_init__(self) -> None:
        _fit(self, "member mirrored", self.member.shape)

    @classmethod
    def empty(cls, people: int, views: int) -> Groups:
        """Return groups without any association."""
        return cls(np.full((people, views), -1, np.int64), np.zeros((people, views), bool))

    def joined(self, other: Groups) -> Groups:
        """Return the rows of both groups."""
        return Groups(
            np.concatenate([self.member, other.member]), np.concatenate([self.mirrored, other.mirrored])
        )

    def rows(self, which: Array) -> Groups:
        """Return the people with these indices."""
        return Groups(self.member[which], self.mirrored[which])


@dataclass(frozen=True, slots=True, eq=False)
class AssociationSet:
    """People of one instant before their joints are solved.

    Args:
        detections: The detections from which the people were made.
        evidence: The same as flat arrays.
        groups: 2D poses of P people.
        who: (P,) row of the prediction that each person continues, -1 = new.
        places: (P, J, 3) m, rough joint positions: predicted, or triangulated; NaN = unknown.
        prediction: All tracked people, also those who were not found.

    Raises:
        DataError: if the arrays do not fit each other.
    """

    detections: DetectionSet
    evidence: Evidence
    groups: Groups
    who: Array
    places: Array
    prediction: Prediction

    def __post_init__(self) -> None:
        people = len(self.who)
        _fit(self, "who", (people,))
        if self.groups.member.shape != (people, self.evidence.views):
            raise DataError(
                f"AssociationSet.groups has shape {self.groups.member.shape}, expected people and views "
                f"{(people, self.evidence.views)}"
            )
        joints = self.evidence.scores.shape[1]
        _fit(self, "places", (people, joints, 3))
        if self.prediction.ages.shape[1] != joints:
            raise DataError(
                f"an AssociationSet of people of {joints} joints with predictions of "
                f"{self.prediction.ages.shape[1]}"
            )

    @property
    def index(self) -> int:
        """Return the index of the detection set."""
        return self.detections.index

    @property
    def stamp_ns(self) -> int:
        """Return the timestamp of the detection set."""
        return self.detections.stamp_ns


@dataclass(frozen=True, slots=True, eq=False)
class TrackSet:
    """T tracks at one instant, confirmed or not.

    Args:
        index, stamp_ns, skeleton_hash: Those of the newest skeletons that tracking received.
        ids: (T,) public identities, -1 = not confirmed yet.
        states: (T, J, 6) position m and velocity m/s, NaN = unknown.
        variances: (T, J, 3) per axis: position variance, position-velocity covariance, velocity variance; see
            `identity.motion`.
        ages: (T, J) s since each joint was measured.
        unagreed: (T, J) s since three views agreed on it.
        unseen: (T,) s since the person was seen.
        lengths: (T, B) m, learnt lengths of the skeleton's bones, NaN = unknown; (T, 0) = no lengths.

    Raises:
        DataError: if the arrays do not fit each other, or states are infinite.
    """

    index: int
    stamp_ns: int
    skeleton_hash: str
    ids: Array
    states: Array
    variances: Array
    ages: Array
    unagreed: Array
    unseen: Array
    lengths: Array = NOT_GIVEN

    def __post_init__(self) -> None:
        object.__setattr__(self, "stamp_ns", check_stamp(self, self.stamp_ns))
        shape = self.ages.shape
        _fit_lengths(self, shape[0])
        _fit(self, "ids unseen", shape[:1])
        _fit(self, "ages unagreed", shape)
        _fit(self, "states", (*shape, 6))
        _fit(self, "variances", (*shape, 3))
        check_not_infinite(self, "states variances")


def _fit_lengths(record: Prediction | TrackSet, people: int) -> None:
    """Store the bone lengths (people, B) read-only, with B = 0 if they are not given.

    Raises:
        DataError: if their shape does not fit, or a length is infinite.
    """
    if record.lengths is None:
        object.__setattr__(record, "lengths", np.zeros((people, 0)))
    _fit(record, "lengths", (people, *record.lengths.shape[1:2]))
    check_not_infinite(record, "lengths")


def _fit(record: object, names: str, shape: tuple[int, ...]) -> None:
    """Store read-only copies of the named arrays and check their shape.

    Raises:
        DataError: if a shape differs.
    """
    for name in names.split():
        array = own_copy(getattr(record, name))
        object.__setattr__(record, name, array)
        if array.shape != shape:
            raise DataError(f"{type(record).__name__}.{name} has shape {array.shape}, expected {shape}")


@dataclass(frozen=True, slots=True, eq=False)
class ProposalSet:
    """3D node proposals and scored parts of one instant (Joo et al. 2017, 5.1 and 5.2).

    Args:
        association: The known people, so that assembly needs no other input.
        nodes: (N, 3) m, putative joint positions in the world.
        node_joints: (N,) joint of each node.
        node_scores: (N,) in 0..1, the vote of eq. 1.
        node_views: (N,) number of views that support the node.
        parts: (M, 2) nodes (of the parent joint, of the child joint).
        part_bones: (M,) index into `SkeletonModel.bones`; -1 = a part across one missing joint.
        part_scores: (M,) in 0..1, connectivity over the views (5.2).
    """

    association: AssociationSet
    nodes: Array
    node_joints: Array
    node_scores: Array
    node_views: Array
    parts: Array
    part_bones: Array
    part_scores: Array

    def __post_init__(self) -> None:
        shapes = ShapeChecks(self)
        nodes = shapes.store("nodes", np.float64, "N 3")
        shapes.store("node_joints", np.int32, "N")
        check_scores(self, "node_scores", shapes.store("node_scores", np.float64, "N"))
        shapes.store("node_views", np.int32, "N")
        parts = shapes.store("parts", np.int32, "M 2")
        shapes.store("part_bones", np.int32, "M")
        check_scores(self, "part_scores", shapes.store("part_scores", np.float64, "M"))
        if not np.isfinite(nodes).all():
            raise DataError("ProposalSet.nodes is not finite")
        if parts.size and not 0 <= parts.min() <= parts.max() < len(nodes):
            raise DataError("ProposalSet.parts names a node that does not exist")

    @classmethod
    def of_nothing(cls, association: AssociationSet) -> ProposalSet:
        """Return a set without proposals, which only holds the association."""
        none = np.zeros(0)
        return cls(association, np.zeros((0, 3)), none, none, none, np.zeros((0, 2)), none, none)

    @property
    def of_maps(self) -> bool:
        """Return whether the nodes add information from score maps to the 2D poses."""
        return len(self.nodes) > 0 and any(view.maps is not None for view in self.detections.views)

    @property
    def detections(self) -> DetectionSet:
        """Return the detection set behind the proposals."""
        return self.association.detections

    @property
    def index(self) -> int:
        """Return the index of the detection set."""
        return self.detections.index

    @property
    def stamp_ns(self) -> int:
        """Return the timestamp of the detection set."""
        return self.detections.stamp_ns
