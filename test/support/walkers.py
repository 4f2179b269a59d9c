"""People who walk before exact cameras, some of which turn or zoom: what the health stage takes."""

from dataclasses import replace
from functools import cache

import captures
import numpy as np

from panoptic_ros.domain import (
    AssociationSet,
    DetectionSet,
    Groups,
    JointState,
    Prediction,
    TrackedPoseSet,
    ViewSources,
)
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.geometry import Rigid
from panoptic_ros.geometry.rotations import rotations_of
from panoptic_ros.solving.scene import gather

ARRAYS = RigArrays.of(captures.RIG)
STEP_NS = 100_000_000


def turned(camera, degrees):
    """Return the camera turned about its centre by a vector (3,) of degrees in its own axes."""
    turn = rotations_of(np.deg2rad(np.array(degrees, float))[None])[0]
    pose = camera.cam_from_world
    return replace(camera, cam_from_world=Rigid(turn @ pose.rotation, turn @ pose.translation))


def zoomed(camera, factor):
    """Return the camera with another focal length."""
    matrix = camera.intrinsics.matrix.copy()
    matrix[:2, :2] *= factor
    return replace(camera, intrinsics=replace(camera.intrinsics, matrix=matrix))


def instant(index, cameras, time_s):
    """Return an association of the two people of `captures`, and the people who were made from it."""
    stamp = index * STEP_NS
    seen = captures.people(time_s)
    views = []
    for camera, known in zip(cameras, captures.RIG.cameras):
        view = captures.view(camera, index, stamp)
        pixels, there = camera.project(seen)
        noise = np.random.default_rng([index, known.image_size[0]]).normal(0.0, 0.5, pixels.shape)
        there &= camera.contains(pixels)
        points, scores = np.where(there[..., None], pixels + noise, np.nan), np.where(there, 0.9, 0.0)
        views.append(replace(view, points=points, scores=scores, person_scores=scores.max(1)))
    detections = DetectionSet(index, stamp, captures.SKELETON.hash, tuple(views))
    evidence = gather(detections, ARRAYS, captures.SKELETON, captures.SKELETON.hash, 0.0)
    people, count = len(seen), len(views)
    nobody = Prediction.of_nobody(seen.shape[1])
    groups = Groups.empty(people, count)
    association = AssociationSet(detections, evidence, groups, np.full(people, -1), seen, nobody)
    ones = np.ones(seen.shape[:2])
    persons = np.repeat(np.arange(people)[:, None], count, axis=1)
    sources = ViewSources(captures.RIG.names, np.full(count, index), persons)
    tracked = TrackedPoseSet(
        index,
        stamp,
        captures.SKELETON.hash,
        seen,
        np.tile(1e-4 * np.eye(3), (*ones.shape, 1, 1)),
        ones,
        count * ones,
        JointState.MEASURED * ones,
        np.ones(people),
        ids=np.array([4, 9]),
        sources=sources,
    )
    return association, tracked


def walk(seconds, changes=(), start_s=0.0, still=False):
    """Items of the health stage, ten instants a second.

    Args:
        changes: Pairs of a time (s) and the cameras that film from then on.
        still: Whether all people stand still.
    """
    items = []
    for index in range(round(10 * seconds)):
        time_s = 0.1 * index
        cameras = captures.RIG.cameras
        for since, those in changes:
            cameras = those if time_s >= since else cameras
        items += instant(index, cameras, 0.0 if still else start_s + time_s)
    return items


@cache
def walked():
    """Return a walk during which one camera turns, and another one zooms."""
    first, second, *rest = captures.RIG.cameras
    one = (turned(first, (0.0, 0.6, 0.0)), second, *rest)
    return walk(34, ((14, one), (24, (one[0], zoomed(second, 1.03), *rest))))
