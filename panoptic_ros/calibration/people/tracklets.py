"""CameraLink the 2D poses of one camera over time: tracklets, and the image velocities of their joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from panoptic_ros.domain import ViewDetections
from panoptic_ros.geometry import Intrinsics

Array = np.ndarray
GATE = 0.3  # median distance of joints between two frames over the size of the person; people walk 0.1
GAP = 4.5  # frame periods without the person, after which a tracklet ends
LONGEST_GAP_S = 0.5  # s, the same limit for slow cameras
FEWEST_JOINTS = 4  # joints of a 2D pose that is used, and that two poses of a tracklet share
FEWEST_FRAMES = 8  # frames of a tracklet
RIVAL = 2.0  # a second 2D pose within this factor of the distance of the first ends the tracklet
WINDOW = 3  # frames before and after, whose slopes give an image velocity
SLOWEST_S = 0.35  # s, between the two frames of a slope


@dataclass(frozen=True, eq=False)
class Tracklet:
    """2D poses of one person in one camera over time.

    Args:
        camera: Index of the camera. intrinsics: Its lens.
        stamps: (T,) s, increasing.
        points: (T, J, 2) px, NaN where a joint is missing.
        scores: (T, J), 0 where it is missing.
    """

    camera: int
    intrinsics: Intrinsics
    stamps: Array
    points: Array
    scores: Array

    def cut(self, first_s: float, last_s: float) -> Tracklet:
        """Return the part within a time span."""
        own = slice(*np.searchsorted(self.stamps, [first_s, last_s]))
        return replace(self, stamps=self.stamps[own], points=self.points[own], scores=self.scores[own])

    @cached_property
    def plane(self) -> Array:
        """Return the undistorted normalised points (T, J, 2)."""
        return self.intrinsics.undistort(self.points)

    @cached_property
    def plane_speeds(self) -> Array:
        """Return their velocities (T, J, 2) s^-1, 0 where unknown."""
        return image_velocities(self.stamps, self.plane)

    @property
    def travel(self) -> float:
        """Return the length of the median joint's way in the image over the median size of the person."""
        middles = np.nanmedian(self.points, axis=1)
        steps = np.linalg.norm(middles[WINDOW::WINDOW] - middles[:-WINDOW:WINDOW], axis=1)
        return float(np.nansum(steps) / np.nanmedian(sizes_of(self.points)))


class _Open(NamedTuple):
    """Tracklet that may go on: its frames, each with stamp, points and scores."""

    frames: list[tuple[float, Array, Array]]


def sizes_of(points: Array) -> Array:
    """Return the diagonals (...) px of the boxes around poses (..., J, 2) px, NaN = missing."""
    extent = np.nanmax(points, axis=-2) - np.nanmin(points, axis=-2)
    sizes: Array = np.maximum(np.linalg.norm(extent, axis=-1), 1.0)
    return sizes


def link_camera(
    camera: int, views: Sequence[ViewDetections], start_ns: int, joints: Array, intrinsics: Intrinsics
) -> list[Tracklet]:
    """Return the tracklets of one camera.

    Args:
        views: Views of the camera, in any order.
        start_ns: Stamp of time 0.
        joints: Joints of the skeleton that are used.
    """
    ordered = sorted(views, key=lambda view: view.stamp_ns)
    stamps = np.array([1e-9 * (view.stamp_ns - start_ns) for view in ordered])
    steps = np.diff(stamps)
    period = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    longest = min(GAP * period, max(LONGEST_GAP_S, 1.5 * period))
    running: list[_Open] = []
    done: list[_Open] = []
    for stamp, view in zip(stamps, ordered):
        poses = _poses(view, joints)
        ended = [own for own in running if stamp - own.frames[-1][0] > longest]
        done += ended
        running = [own for own in running if stamp - own.frames[-1][0] <= longest]
        running = _extended(running, done, float(stamp), poses)
    done += running
    return [_tracklet(camera, own, intrinsics) for own in done if len(own.frames) >= FEWEST_FRAMES]


def _poses(view: ViewDetections, joints: Array) -> list[tuple[Array, Array]]:
    """Return points (J, 2) and scores (J,) of the people of a view that are seen, not propagated."""
    points, scores = view.points[:, joints], view.scores[:, joints]
    fresh = np.ones(len(points), bool) if view.carried is None else view.carried == 0.0
    use = fresh & (np.isfinite(points).all(axis=2).sum(axis=1) >= FEWEST_JOINTS)
    return list(zip(points[use], scores[use]))


def _extended(
    running: list[_Open], done: list[_Open], stamp: float, poses: list[tuple[Array, Array]]
) -> list[_Open]:
    """Return the tracklets after one frame; those whose continuation is ambiguous end and move to `done`."""
    if not running or not poses:
        return running + [_Open([(stamp, *pose)]) for pose in poses]
    last = np.stack([own.frames[-1][1] for own in running])
    now = np.stack([points for points, _ in poses])
    apart = np.linalg.norm(last[:, None] - now[None], axis=-1)
    common = np.isfinite(apart).sum(axis=2)
    middle = np.maximum(common - 1, 0)[..., None] // 2
    median = np.take_along_axis(np.sort(apart, axis=2), middle, axis=2)[..., 0]
    cost = np.where(common >= FEWEST_JOINTS, median, np.inf) / sizes_of(last)[:, None]
    cost[cost > GATE] = np.inf
    ended, taken = set(), set()
    for row, column in zip(*linear_sum_assignment(np.where(np.isfinite(cost), cost, 1e3))):
        if not np.isfinite(cost[row, column]):
            continue
        rivals = np.concatenate([np.delete(cost[row], column), np.delete(cost[:, column], row)])
        if len(rivals) and rivals.min() < RIVAL * cost[row, column]:
            ended.add(int(row))
            continue
        running[row].frames.append((stamp, *poses[column]))
        taken.add(int(column))
    done += [own for k, own in enumerate(running) if k in ended]
    going = [own for k, own in enumerate(running) if k not in ended]
    return going + [_Open([(stamp, *pose)]) for k, pose in enumerate(poses) if k not in taken]


def _tracklet(camera: int, own: _Open, intrinsics: Intrinsics) -> Tracklet:
    stamps, points, scores = zip(*own.frames)
    return Tracklet(camera, intrinsics, np.array(stamps), np.stack(points), np.stack(scores))


def image_velocities(stamps: Array, points: Array) -> Array:
    """Return the velocities (T, J, 2) s^-1 of image points (T, J, 2); 0 where nothing determines them.

    Each is the median of the slopes between all frames of a window (Theil 1950, Sen 1968). It withstands a
    quarter of wrong frames: exchanged sides give speeds of several m/s, which would draw clock offsets to 0.
    """
    count = len(stamps)
    padded = np.full((count + 2 * WINDOW, *points.shape[1:]), np.nan)
    padded[WINDOW : WINDOW + count] = points
    times = np.full(count + 2 * WINDOW, np.nan)
    times[WINDOW : WINDOW + count] = stamps
    slopes = []
    for first in range(2 * WINDOW):
        for second in range(first + 2, 2 * WINDOW + 1):
            step = times[second : second + count] - times[first : first + count]
            step[~(step < SLOWEST_S)] = np.nan
            moves = padded[second : second + count] - padded[first : first + count]
            slopes.append(moves / step[:, None, None])
    every = np.stack(slopes)
    known = np.isfinite(every).any(axis=0)
    speeds = np.zeros(points.shape)
    speeds[known] = np.nanmedian(every[:, known], axis=0)
    return speeds
