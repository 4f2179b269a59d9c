"""People from voted nodes and parts, as in Joo et al. 2017, 5.3: without robust weights, each instant alone.

A joint with two or more corresponding 2D joints is refined by minimising the squared reprojection error, and
all its 2D joints have equal weights. Other joints stay at their nodes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from panoptic_ros.assembly.config import AssemblyConfig
from panoptic_ros.assembly.dynamic_programming import assemble
from panoptic_ros.assembly.judgement import AssembledPeople, JointEstimates
from panoptic_ros.domain import DetectionSet, ProposalSet, Rig, SkeletonModel, ViewSources
from panoptic_ros.geometry import ProjectionStack, Triangulation, triangulate_robust

Array = np.ndarray

PLAIN = 1e9  # standard deviations: no residual is an outlier, except points behind a camera (infinite)


def people_from_parts(
    item: ProposalSet, rig: Rig, skeleton: SkeletonModel, config: AssemblyConfig
) -> AssembledPeople:
    """Return the people of an instant, in the order of their scores."""
    views = item.detections.views
    found = assemble(item, rig, skeleton, config.correspondence_px)
    nodes = np.array([person.nodes for person in found], np.int64).reshape(-1, len(skeleton))
    claims = np.array([person.claims for person in found], np.int64).reshape(*nodes.shape, len(views))
    there = nodes >= 0
    start = np.where(there[..., None], _taken(item.nodes, nodes), np.nan)
    refined = _refined(item.detections, rig, claims, start, config.initial_noise)
    solved = np.isfinite(refined.points[:, 0]).reshape(nodes.shape)
    at_node = config.node_sigma**2 * np.where(there, 1.0, np.nan)[..., None, None] * np.eye(3)
    joints = JointEstimates(
        np.where(solved[..., None], refined.points.reshape(start.shape), start),
        np.where(solved[..., None, None], refined.covariances.reshape(at_node.shape), at_node),
        np.where(there, _taken(item.node_scores, nodes), 0.0),
        np.where(solved, (claims >= 0).sum(axis=-1), np.where(there, _taken(item.node_views, nodes), 0)),
        np.zeros(nodes.shape),
    )
    placed = np.zeros(nodes.shape, bool)
    return AssembledPeople(np.arange(len(nodes)), joints, _sources(item.detections, claims), placed)


def _refined(detections: DetectionSet, rig: Rig, claims: Array, start: Array, noise: float) -> Triangulation:
    """Return the joints (P * J) with the least squared reprojection error.

    Joints that fewer than two views claim are NaN.

    Args:
        claims: (P, J, V), see `dynamic_programming.SkeletonHypothesis`.
        start: (P, J, 3) m, world.
        noise: Standard deviation of 2D joints, as a share of the image diagonal.
    """
    cameras = [rig.camera(view.camera) for view in detections.views]
    plane = np.full((*claims.shape, 2), np.nan)
    for v, (camera, view) in enumerate(zip(cameras, detections.views)):
        person, joint = np.nonzero(claims[..., v] >= 0)
        pixels = view.points[claims[person, joint, v], joint]
        plane[person, joint, v] = camera.intrinsics.undistort(pixels)
    sigmas = np.array([noise * math.hypot(*camera.image_size) for camera in cameras])
    count = claims.shape[0] * claims.shape[1]
    return triangulate_robust(
        _stack(rig, [camera.name for camera in cameras]),
        plane.reshape(count, len(cameras), 2),
        np.broadcast_to(sigmas, (count, len(cameras))),
        start.reshape(count, 3),
        cauchy=PLAIN,
        gate=PLAIN,
    )


def _stack(rig: Rig, names: Sequence[str]) -> ProjectionStack:
    """Return the projections of some cameras, in the order of the names."""
    stack, rows = rig.stack(), [rig.names.index(name) for name in names]
    return ProjectionStack(stack.rotations[rows], stack.translations[rows], stack.focals[rows])


def _sources(detections: DetectionSet, claims: Array) -> ViewSources:
    """Return the 2D pose of each view that supplied most joints of each person.

    Args:
        claims: (P, J, V), see `dynamic_programming.SkeletonHypothesis`.
    """
    most = max((len(view.points) for view in detections.views), default=0)
    given = (claims[..., None] == np.arange(most)).sum(axis=1)  # (P, V, 2D people)
    main = given.argmax(axis=-1) if most else np.zeros(given.shape[:2], np.int64)
    return ViewSources(
        tuple(view.camera for view in detections.views),
        np.array([view.frame_number for view in detections.views], np.int64),
        np.where((claims >= 0).any(axis=1), main, -1),
    )


def _taken(values: Array, index: Array) -> Array:
    """Return values[index], 0 where the index is -1."""
    padded = np.concatenate([values, np.zeros((1, *values.shape[1:]), values.dtype)])
    taken: Array = padded[index]
    return taken
