"""Inputs of the pose solver, as arrays for compiled code. Weights are 1 / standard deviation^2.

A robust target with residual r, weight w and scale c has Cauchy's loss c log(1 + w r^2 / c). A scale of 0
means the quadratic loss w r^2. Weight and scale are separate: a higher weight does not make the loss more
robust.

A site is a point that is fixed on a segment: `segments` holds its segment and `offsets` its position in the
frame of that segment.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

Array = np.ndarray


_NO_SEGMENTS = np.zeros(0, np.int64)


class ViewTargets(NamedTuple):
    """2D joints in camera views, on the normalised image plane (depth 1, lens distortion removed; eq. 7).

    Attributes:
        segments, offsets: (N,) and (N, 3) m, the sites of the joints.
        cameras: (N,) camera indices.
        points, weights: (N, 2), and (N,) 1 / variance on the normalised image plane.
        scale: Scale of Cauchy's loss.
        rotations, translations: (C, 3, 3) and (C, 3) m of the cameras, camera from world.
        anchors: (N,) segment whose proximal joint carries the site when lengths change; empty = `segments`.
    """

    segments: Array
    offsets: Array
    cameras: Array
    points: Array
    weights: Array
    scale: float
    rotations: Array
    translations: Array
    anchors: Array = _NO_SEGMENTS


class PointTargets(NamedTuple):
    """3D joints as targets.

    Attributes:
        segments, offsets: (N,) and (N, 3) m, the sites of the joints.
        goals, information: (N, 3) m and (N, 3, 3) 1/m^2, target positions in the world.
        scale: Scale of Cauchy's loss.
        anchors: (N,), as in `ViewTargets`.
    """

    segments: Array
    offsets: Array
    goals: Array
    information: Array
    scale: float
    anchors: Array = _NO_SEGMENTS


class OrientationTargets(NamedTuple):
    """Segment orientations in the world as targets.

    Attributes:
        segments, goals: (N,) and (N, 3, 3).
        weights: (N,), for the squared vector part of the quaternion between segment and goal (eq. 10). For
            small angles the length of this vector part is half of the angle.
        scale: Scale of Cauchy's loss.
    """

    segments: Array
    goals: Array
    weights: Array
    scale: float


class FloorPoints(NamedTuple):
    """Points that stay above the floor (eq. 16).

    Attributes:
        segments: (N,) segments whose proximal joints are these points.
        radius: m, minimum height.
        weight: 1/m^2, of the squared depth below that height.
    """

    segments: Array
    radius: float
    weight: float


class Hinges(NamedTuple):
    """Joints that bend about one axis of the parent. The segment may rotate freely about its own bone.

    Attributes:
        segments: (H,).
        axes, bones: (H, 3) unit vectors, in the frame of the parent and in the frame of the segment.
        weight: Weight of the squared sine of the angle between the bone and the plane perpendicular to the
            axis.
    """

    segments: Array
    axes: Array
    bones: Array
    weight: float


class PosePrior(NamedTuple):
    """Prior of poses (eq. 14, 15).

    The rotation vectors of all segments except the root differ from `mean` by d, rad. The cost is
    projection_weight d^T projection d + deviation_weight d^T deviation d. Each of the two terms has Cauchy's
    loss with its own scale.

    Attributes:
        mean: (3 S - 3,) rad.
        projection, deviation: (3 S - 3, 3 S - 3).
        lower, upper: (3 S - 3,) rad, joint limits.
        limit_weight: 1/rad^2, of the squared angle beyond these limits.
        hinges: Joints that bend about one axis.
    """

    mean: Array
    projection: Array
    deviation: Array
    lower: Array
    upper: Array
    projection_weight: float
    projection_scale: float
    deviation_weight: float
    deviation_scale: float
    limit_weight: float
    hinges: Hinges


class Anchor(NamedTuple):
    """Quadratic cost of the increment u from a reference pose: weight (u^T information u + 2 gradient^T u).

    Attributes:
        root, turns: (3,) m and (S, 3, 3), the reference pose.
        information, gradient: (D, D) and (D,).
    """

    root: Array
    turns: Array
    information: Array
    gradient: Array
    weight: float


class PoseEvidence(NamedTuple):
    """All evidence for the pose of one instant. `weight` multiplies its whole cost, but not the anchor's."""

    views: ViewTargets
    points: PointTargets
    turns: OrientationTargets
    floor: FloorPoints
    prior: PosePrior
    weight: float


NO_VIEWS = ViewTargets(
    _NO_SEGMENTS,
    np.zeros((0, 3)),
    _NO_SEGMENTS,
    np.zeros((0, 2)),
    np.zeros(0),
    0.0,
    np.zeros((0, 3, 3)),
    np.zeros((0, 3)),
)
NO_POINTS = PointTargets(_NO_SEGMENTS, np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3, 3)), 0.0)
NO_TURNS = OrientationTargets(_NO_SEGMENTS, np.zeros((0, 3, 3)), np.zeros(0), 0.0)
NO_FLOOR = FloorPoints(_NO_SEGMENTS, 0.0, 0.0)
NO_HINGES = Hinges(_NO_SEGMENTS, np.zeros((0, 3)), np.zeros((0, 3)), 0.0)


def no_anchor(segments: int) -> Anchor:
    """Return an anchor of weight 0, for a chain of `segments` segments."""
    size = 3 + 3 * segments
    return Anchor(
        np.zeros(3), np.tile(np.eye(3), (segments, 1, 1)), np.zeros((size, size)), np.zeros(size), 0.0
    )


class Accelerations(NamedTuple):
    """Measured accelerations of sites at the previous instant, in the world, without gravity (eq. 12).

    Attributes:
        segments, offsets: (N,) and (N, 3) m, the sites.
        values, weights: (N, 3) m/s^2 and (N,) 1/(m/s^2)^2.
        scale: Scale of Cauchy's loss.
        relative: True if the common part of all accelerations is unknown or not trusted.
    """

    segments: Array
    offsets: Array
    values: Array
    weights: Array
    scale: float
    relative: bool = False


class RotationIncrements(NamedTuple):
    """Measured rotations of segments from the previous to the new instant, in the world.

    A constant error of a mounting cancels in them.

    Attributes:
        segments, changes, weights: (N,), (N, 3, 3) and (N,) 1/rad^2.
    """

    segments: Array
    changes: Array
    weights: Array


class SiteDisplacements(NamedTuple):
    """Sites of known displacement from the previous to the new instant, such as those of a standing foot.

    Attributes:
        segments, offsets: (N,) and (N, 3) m, the sites.
        moves, weights: (N, 3) m, the displacements, and (N,) 1/m^2.
    """

    segments: Array
    offsets: Array
    moves: Array
    weights: Array


NO_ACCELERATIONS = Accelerations(_NO_SEGMENTS, np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), 0.0)
NOTHING_TURNS = RotationIncrements(_NO_SEGMENTS, np.zeros((0, 3, 3)), np.zeros(0))
NOTHING_STANDS = SiteDisplacements(_NO_SEGMENTS, np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))


class IncrementEvidence(NamedTuple):
    """Measurements between the previous and the new instant.

    Attributes:
        stride: Number of periods between the two.
    """

    accelerations: Accelerations = NO_ACCELERATIONS
    turning: RotationIncrements = NOTHING_TURNS
    standing: SiteDisplacements = NOTHING_STANDS
    stride: int = 1


NOTHING_BETWEEN = IncrementEvidence()
