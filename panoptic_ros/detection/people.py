"""What a decoder gives: people in the pixels of the network's input, and score maps on its grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.detection.resemblance import distinct

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class People:
    """P people with K joints each, best first; in px told from the first pixel's centre.

    Args:
        points: (P, K, 2); scores: (P, K) in 0..1, 0 = not found.
        person_scores: (P,) in 0..1.
        boxes: (P, 4) left, top, right, bottom.
    """

    points: Array
    scores: Array
    person_scores: Array
    boxes: Array

    def __len__(self) -> int:
        return len(self.person_scores)

    def select(self, index: Array) -> People:
        """Some of the people, in the given order."""
        return People(self.points[index], self.scores[index], self.person_scores[index], self.boxes[index])

    def transformed(self, affine: Array) -> People:
        """Points and boxes under a (2, 3) affine map that does not turn or mirror."""
        corners = self.boxes.reshape(-1, 2) @ affine[:, :2].T + affine[:, 2]
        points = self.points @ affine[:, :2].T + affine[:, 2]
        return People(points, self.scores, self.person_scores, corners.reshape(-1, 4))

    def heights(self) -> Array:
        """Longer side (P,) of each person's box: a person's length whatever way he lies or stands."""
        sizes: Array = np.maximum(self.boxes[:, 2] - self.boxes[:, 0], self.boxes[:, 3] - self.boxes[:, 1])
        return sizes


def no_people(joint_count: int) -> People:
    """Nobody."""
    return People(np.zeros((0, joint_count, 2)), np.zeros((0, joint_count)), np.zeros(0), np.zeros((0, 4)))


def concatenate(parts: list[People], joint_count: int) -> People:
    """The people of several answers, in their order."""
    if not parts:
        return no_people(joint_count)
    return People(
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.scores for part in parts]),
        np.concatenate([part.person_scores for part in parts]),
        np.concatenate([part.boxes for part in parts]),
    )


def boxes_of_points(points: Array, seen: Array) -> Array:
    """Boxes (P, 4) round the seen (P, K) points (P, K, 2); everybody must show at least one."""
    low = np.where(seen[..., None], points, np.inf).min(axis=1)
    high = np.where(seen[..., None], points, -np.inf).max(axis=1)
    return np.concatenate([low, high], axis=1)


def suppress_overlaps(boxes: Array, scores: Array, iou: float) -> Array:
    """Indices of the boxes (N, 4) that stay, best first, after dropping those that overlap a better one.

    Greedy non-maximum suppression; equal scores keep their order.
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


def without_duplicates(people: People, seen: Array, overlap: float) -> Array:
    """Indices of the people whose joints do not coincide with the joints of a better one.

    Two people's likeness is the mean over the joints that both show of exp(-d^2 / 2 s^2), with s
    5 % of the better one's height (as object keypoint similarity, COCO, with one width for all).

    Args:
        people: best first; seen: (P, K) which joints count, at least one of each person.
        overlap: likeness above which the second is dropped; 1 = never.
    """
    if overlap >= 1.0 or len(people) < 2:
        return np.arange(len(people))
    kept: Array = np.flatnonzero(distinct(np.array(people.points, np.float64, order="C"), seen, overlap))
    return kept
