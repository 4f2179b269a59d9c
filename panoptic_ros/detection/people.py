"""People that a decoder returns, and the suppression of overlaps and duplicates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.detection.resemblance import distinct

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class DetectedPeople:
    """P people with K joints each, best first. Coordinates are px with the first pixel's centre as origin.

    Args:
        points: (P, K, 2) joints.
        scores: (P, K) in 0..1, 0 = not found.
        person_scores: (P,) in 0..1.
        boxes: (P, 4) left, top, right, bottom.
    """

    points: Array
    scores: Array
    person_scores: Array
    boxes: Array

    def __len__(self) -> int:
        return len(self.person_scores)

    def select(self, index: Array) -> DetectedPeople:
        """Return the people at the given indices, in that order."""
        return DetectedPeople(
            self.points[index], self.scores[index], self.person_scores[index], self.boxes[index]
        )

    def transformed(self, affine: Array) -> DetectedPeople:
        """Apply a (2, 3) affine map without rotation or mirroring to points and boxes."""
        corners = self.boxes.reshape(-1, 2) @ affine[:, :2].T + affine[:, 2]
        points = self.points @ affine[:, :2].T + affine[:, 2]
        return DetectedPeople(points, self.scores, self.person_scores, corners.reshape(-1, 4))

    def heights(self) -> Array:
        """Return the longer side (P,) of each box: the length of a person, whether lying or standing."""
        sizes: Array = np.maximum(self.boxes[:, 2] - self.boxes[:, 0], self.boxes[:, 3] - self.boxes[:, 1])
        return sizes


def no_people(joint_count: int) -> DetectedPeople:
    """Return an empty instance."""
    return DetectedPeople(
        np.zeros((0, joint_count, 2)), np.zeros((0, joint_count)), np.zeros(0), np.zeros((0, 4))
    )


def concatenate(parts: list[DetectedPeople], joint_count: int) -> DetectedPeople:
    """Concatenate the people of several parts, in their order."""
    if not parts:
        return no_people(joint_count)
    return DetectedPeople(
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.scores for part in parts]),
        np.concatenate([part.person_scores for part in parts]),
        np.concatenate([part.boxes for part in parts]),
    )


def boxes_of_points(points: Array, seen: Array) -> Array:
    """Return boxes (P, 4) round the seen (P, K) points (P, K, 2); each person needs at least one."""
    low = np.where(seen[..., None], points, np.inf).min(axis=1)
    high = np.where(seen[..., None], points, -np.inf).max(axis=1)
    return np.concatenate([low, high], axis=1)


def suppress_overlaps(boxes: Array, scores: Array, iou: float) -> Array:
    """Return indices of the boxes (N, 4) that remain, best first, without those that overlap a better one.

    This is greedy non-maximum suppression; equal scores keep their order.

    Args:
        scores: (N,) score of each box.
        iou: Intersection over union above which the worse box is dropped.
    """
    order = np.argsort(-scores, kind="stable")
    area = np.prod(np.maximum(boxes[:, 2:] - boxes[:, :2], 0.0), axis=1)
    kept: list[int] = []
    while order.size:
        best, order = int(order[0]), order[1:]
        kept.append(best)
        low = np.maximum(boxes[order, :2], boxes[best, :2])
        high = np.minimum(boxes[order, 2:], boxes[best, 2:])
        shared = np.prod(np.maximum(high - low, 0.0), axis=1)
        union = area[order] + area[best] - shared
        order = order[shared <= iou * np.maximum(union, 1e-9)]
    return np.array(kept, int)


def without_duplicates(people: DetectedPeople, seen: Array, overlap: float) -> Array:
    """Return the indices of people whose joints do not coincide with those of a better person.

    The similarity of two people is the mean of exp(-d^2 / 2 s^2) over the joints that both have. The distance
    of the joints is d. The width s is 5 % of the height of the better person. This is object keypoint
    similarity (COCO) with one width for all joints.

    Args:
        people: Best first.
        seen: (P, K) which joints count, at least one of each person.
        overlap: Similarity above which the worse person is dropped; 1 = never.
    """
    if overlap >= 1.0 or len(people) < 2:
        return np.arange(len(people))
    kept: Array = np.flatnonzero(distinct(np.array(people.points, np.float64, order="C"), seen, overlap))
    return kept
