"""Corner numbers of boards that look the same after a turn: a view may have any of several numberings."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from panoptic_ros.calibration.target_views import TargetView
from panoptic_ros.geometry import Rigid
from panoptic_ros.geometry.rotations import vectors_of

Array = np.ndarray
LEVER = 1.0  # m, distance at which a rotation counts like a translation
SAME = 0.1  # m, distance between poses of a target beyond which a view does not vote


def alternatives(poses: Sequence[Rigid], turns: Sequence[Rigid]) -> list[Rigid]:
    """Return poses, camera from target, and those of every other numbering behind them."""
    return [*poses, *(pose.compose(turn) for turn in turns for pose in poses)]


def consistent_numbers(
    views: Sequence[TargetView],
    poses: Sequence[Sequence[Rigid]],
    cameras: Sequence[Rigid],
    points: Array,
    turns: Sequence[Rigid],
) -> list[TargetView]:
    """Return the views with numbers that agree within each instant, and over time.

    The pose of an instant is the candidate with the least sum of truncated distances to the views. Each view
    takes the numbering whose pose is nearest to it. The numbering of an instant follows the instant before.

    Args:
        poses: By view, candidates of the pose, camera from target, in the numbering of the view.
        cameras: Camera from world.
        points: (N, 3) m, points of the target.
        turns: See `Board.turns`.
    """
    renamed = [_permutation(points, turn.inverse()) for turn in turns]
    at: dict[int, list[int]] = defaultdict(list)
    for k, view in enumerate(views):
        if poses[k]:
            at[view.instant].append(k)
    found = list(views)
    last: Rigid | None = None
    for instant in sorted(at):
        placed = {}
        for k in at[instant]:
            world_from_camera = cameras[views[k].camera].inverse()
            placed[k] = [world_from_camera.compose(pose) for pose in alternatives(poses[k], turns)]
        last = _agreed(list(placed.values()), turns, last)
        for k, own in placed.items():
            numbering = _nearest(last, own)[1] // len(poses[k])
            if numbering:
                numbers = renamed[numbering - 1][views[k].numbers]
                order = np.argsort(numbers)
                found[k] = replace(views[k], numbers=numbers[order], pixels=views[k].pixels[order])
    return found


def _agreed(placed: Sequence[Sequence[Rigid]], turns: Sequence[Rigid], last: Rigid | None) -> Rigid:
    """Return the pose of a target that agrees best with the candidates of its views, near its last pose."""
    best = min(
        (pose for own in placed for pose in own),
        key=lambda pose: sum(min(SAME, _nearest(pose, own)[0]) for own in placed),
    )
    if last is None:
        return best
    every = alternatives([best], turns)
    return every[_nearest(last, every)[1]]


def _permutation(points: Array, motion: Rigid) -> Array:
    """Return the number (N,) of the point to which a motion brings each of points (N, 3)."""
    apart = np.linalg.norm(motion.apply(points)[:, None] - points[None], axis=2)
    numbers: Array = np.argmin(apart, axis=1)
    return numbers


def _nearest(pose: Rigid, others: Sequence[Rigid]) -> tuple[float, int]:
    """Return distance and index of the nearest of other poses."""
    turns = np.ascontiguousarray([pose.rotation @ other.rotation.T for other in others])
    moves = np.stack([pose.translation - other.translation for other in others])
    distances = LEVER * np.linalg.norm(vectors_of(turns), axis=1) + np.linalg.norm(moves, axis=1)
    nearest = int(np.argmin(distances))
    return float(distances[nearest]), nearest
