"""Interpolate the 2D poses of a camera to the instant of a set, between two of its frames.

`link_people` matches the persons in two frames of one camera.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from panoptic_ros.domain import Camera, ViewDetections
from panoptic_ros.sync.queue import CameraQueue, FrameChoice, QueuedFrame

Array = np.ndarray
FARTHEST = 0.25  # person sizes, maximum motion of a joint between two frames
LONGEST = 1.6  # periods, maximum time between two frames for interpolation
SPEED = 1.0  # m/s, speed assumed for a joint without a known motion
DEPTH = 5.0  # m, depth assumed for the conversion of SPEED to pixels
NOISE_PX = 2.0  # px, noise of a joint with score 1
NEAR = 0.05  # person sizes, scale of the distances at which two joints may be those of one person
LEAST_AGREEMENT = 0.2


@dataclass(frozen=True)
class Neighbours:
    """Chosen frame of a camera with its neighbouring frames."""

    before: QueuedFrame | None
    chosen: QueuedFrame
    after: QueuedFrame | None
    camera: Camera

    @classmethod
    def of(cls, queue: CameraQueue, choice: FrameChoice, camera: Camera) -> Neighbours:
        """Return the frame chosen from a queue with its neighbours, before it is removed from the queue."""
        assert choice.frame is not None
        surplus = len(choice.surplus)
        before = queue.frames[surplus - 1] if surplus else queue.last_given
        after = next((frame for frame in queue.frames if frame.stamp > choice.frame.stamp), None)
        return cls(before, choice.frame, after, camera)


def interpolate(view: Neighbours, instant: int) -> ViewDetections:
    """Return the 2D poses of the chosen frame, interpolated to a timestamp `instant`; score maps are dropped.

    If both frames around the instant have a joint of a linked person, the joint is interpolated linearly. Its
    variance is (1-a)^2 + a^2 times that of one frame, which is smaller. Its score is the mean of both scores,
    weighted like the position. Other joints stay at their position in the chosen frame. Their possible motion
    in the meantime (1 m/s) is treated as noise and lowers their scores.
    """
    chosen = view.chosen.view
    if chosen.stamp_ns == instant:
        return chosen
    scores = chosen.scores * _trust(chosen, instant, view.camera)[None, None]
    points = np.array(chosen.points)
    pair = _around(view, instant)
    if pair is not None:
        first, second = pair
        share = (instant - first.stamp_ns) / (second.stamp_ns - first.stamp_ns)
        sizes = person_sizes(chosen)
        for i, j in link_people(first, second):
            own = i if first is chosen else j
            seen = (first.scores[i] > 0.0) & (second.scores[j] > 0.0)
            way = np.linalg.norm(second.points[j] - first.points[i], axis=-1)
            seen &= np.where(seen, way, np.inf) <= FARTHEST * sizes[own]
            mixed = (1.0 - share) * first.points[i] + share * second.points[j]
            mixed_scores = (1.0 - share) * first.scores[i] + share * second.scores[j]
            points[own] = np.where(seen[:, None], mixed, points[own])
            scores[own] = np.where(seen, mixed_scores, scores[own])
    return replace(chosen, stamp_ns=instant, points=points, scores=np.clip(scores, 0.0, 1.0), maps=None)


def _around(view: Neighbours, instant: int) -> tuple[ViewDetections, ViewDetections] | None:
    """Return the frames before and after the instant, if they are consecutive."""
    chosen = view.chosen
    pair = (chosen, view.after) if chosen.view.stamp_ns < instant else (view.before, chosen)
    first, second = pair
    if first is None or second is None or not first.view.stamp_ns <= instant <= second.view.stamp_ns:
        return None
    period = second.period or float(second.stamp - first.stamp)
    if second.stamp - first.stamp > LONGEST * period:
        return None
    return first.view, second.view


def _trust(view: ViewDetections, instant: int, camera: Camera) -> Array:
    """Return the factor that lowers the score of a joint, because it may have moved since the frame."""
    seconds = abs(instant - view.stamp_ns) * 1e-9
    moved = SPEED * seconds * camera.intrinsics.matrix[0, 0] / DEPTH
    return np.asarray(NOISE_PX**2 / (NOISE_PX**2 + moved**2))


def link_people(first: ViewDetections, second: ViewDetections) -> list[tuple[int, int]]:
    """Return pairs of persons in two frames, matched by joints close to each other (Hungarian assignment).

    The agreement of a pair is the sum over joints of exp(-d^2 / 2 (0.05 size)^2). It is divided by the number
    of joints of the person with fewer joints. Pairs below 0.2 are discarded.
    """
    if not (len(first.points) and len(second.points)):
        return []
    seen_first, seen_second = first.scores > 0.0, second.scores > 0.0
    # (P, Q) larger size of each pair
    size = np.maximum(person_sizes(first)[:, None], person_sizes(second)[None])
    both = seen_first[:, None] & seen_second[None]
    squared = np.square(first.points[:, None] - second.points[None]).sum(-1)
    near = np.where(both, np.exp(-0.5 * squared / np.square(NEAR * size)[..., None]), 0.0).sum(-1)
    fewer = np.minimum(seen_first.sum(1)[:, None], seen_second.sum(1)[None])
    agreement = near / np.maximum(fewer, 1)
    rows, columns = linear_sum_assignment(-agreement)
    return [(int(i), int(j)) for i, j in zip(rows, columns) if agreement[i, j] >= LEAST_AGREEMENT]


def person_sizes(view: ViewDetections) -> Array:
    """Return the longer side of each person's bounding box (P,), px; at least 1."""
    points = np.where(view.scores[..., None] > 0.0, view.points, np.nan)
    sizes = np.ones(len(points))
    for k, person in enumerate(points):
        if np.isfinite(person).any():
            sizes[k] = max(1.0, float(np.max(np.nanmax(person, axis=0) - np.nanmin(person, axis=0))))
    return sizes
