"""What a pose is solved from, as arrays for compiled code. Weights are 1 / standard deviation^2.

A robust target with residual r, weight w and scale c costs c log(1 + w r^2 / c), Cauchy's loss; with a
scale of 0 it costs w r^2. Weight and scale are apart: a higher weight does not make the loss more robust.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

Array = np.ndarray


_NO_SEGMENTS = np.zeros(0, np.int64)


class ViewTargets(NamedTuple):
    """Joints seen in views, on the plane at distance 1 of an undistorted camera (eq. 7).

    segments (N,), offsets (N, 3) m, cameras (N,), points (N, 2), weights (N,) 1 / variance on the plane,
    scale of the loss; rotations (C, 3, 3) and translations (C, 3) of the cameras, camera from world. anchors
    (N,): segments with whose proximal joints sites move when lengths change; none = `segments`.
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
    """Joints in space: segments (N,), offsets (N, 3) m, goals (N, 3) m, information (N, 3, 3) 1/m^2,
    scale; anchors as those of views."""

    segments: Array
    offsets: Array
    goals: Array
    information: Array
    scale: float
    anchors: Array = _NO_SEGMENTS


class TurnTargets(NamedTuple):
    """Orientations in the world: segments (N,), goals (N, 3, 3), weights (N,) of the squared vector part
    of the quaternion between (eq. 10), which is half of the angle; scale."""

    segments: Array
    goals: Array
    weights: Array
    scale: float


class Floor(NamedTuple):
    """Points that stay above the floor (eq. 16): segments (N,), radius m, weight."""

    segments: Array
    radius: float
    weight: float


class Hinges(NamedTuple):
    """Joints that bend about one axis of the parent, however the segment turns about its own bone: segments
    (H,), axes (H, 3) in the parent's frame and bones (H, 3) in the segment's, of length 1, and the weight of
    the squared sine of the angle by which the bone leaves the plane across the axis."""

    segments: Array
    axes: Array
    bones: Array
    weight: float


class PosePrior(NamedTuple):
    """What poses look like (eq. 14, 15): of the rotation vectors d of all segments but the root, less `mean`
    (3 S - 3,), the cost is projection_weight d^T projection d + deviation_weight d^T deviation d, each with
    Cauchy's loss of a scale; limit_weight for what lies beyond `lower` and `upper`, rad; and `hinges`."""

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
    """A quadratic cost of the step u from a pose: u^T information u + 2 gradient^T u, times `weight`.

    root (3,), turns (S, 3, 3); information (D, D), gradient (D,).
    """

    root: Array
    turns: Array
    information: Array
    gradient: Array
    weight: float


class Evidence(NamedTuple):
    """All that speaks for a pose at one instant; the whole is multiplied by `weight`, but for the anchor."""

    views: ViewTargets
    points: PointTargets
    turns: TurnTargets
    floor: Floor
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
NO_TURNS = TurnTargets(_NO_SEGMENTS, np.zeros((0, 3, 3)), np.zeros(0), 0.0)
NO_FLOOR = Floor(_NO_SEGMENTS, 0.0, 0.0)
NO_HINGES = Hinges(_NO_SEGMENTS, np.zeros((0, 3)), np.zeros((0, 3)), 0.0)


def no_anchor(segments: int) -> Anchor:
    """No cost."""
    size = 3 + 3 * segments
    return Anchor(
        np.zeros(3), np.tile(np.eye(3), (segments, 1, 1)), np.zeros((size, size)), np.zeros(size), 0.0
    )


class Accelerations(NamedTuple):
    """Accelerations of sites at the instant before the last, world, gravity taken off (eq. 12).

    segments (N,), offsets (N, 3) m, values (N, 3) m/s^2, weights (N,) 1/(m/s^2)^2, scale of Cauchy's loss.
    relative: a part that all sites share is not known or not trusted.
    """

    segments: Array
    offsets: Array
    values: Array
    weights: Array
    scale: float
    relative: bool = False


class Turning(NamedTuple):
    """How segments turned between the last two instants, in the world: segments (N,), changes (N, 3, 3),
    weights (N,) 1/rad^2. A constant error of the mounting is not in it."""

    segments: Array
    changes: Array
    weights: Array


class Standing(NamedTuple):
    """Sites whose motion between the last two instants is known, as of a foot that stands: segments (N,),
    offsets (N, 3) m, moves (N, 3) m, weights (N,) 1/m^2."""

    segments: Array
    offsets: Array
    moves: Array
    weights: Array


NO_ACCELERATIONS = Accelerations(_NO_SEGMENTS, np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), 0.0)
NOTHING_TURNS = Turning(_NO_SEGMENTS, np.zeros((0, 3, 3)), np.zeros(0))
NOTHING_STANDS = Standing(_NO_SEGMENTS, np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))


class Between(NamedTuple):
    """What was measured between instants; stride: periods from the last one to the new one."""

    accelerations: Accelerations = NO_ACCELERATIONS
    turning: Turning = NOTHING_TURNS
    standing: Standing = NOTHING_STANDS
    stride: int = 1


NOTHING_BETWEEN = Between()
