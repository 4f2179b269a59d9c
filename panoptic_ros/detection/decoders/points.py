"""Decoder of boxes with keypoints, and of boxes alone: RTMO, YOLO-pose, YOLOX.

Lu et al., "RTMO", 2024; Ge et al., "YOLOX", 2021; the tensors of Ultralytics' exports. Coordinates are those
of the network input.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from panoptic_ros.detection.people import DetectedPeople, suppress_overlaps

Array = np.ndarray
YOLOX_STRIDES = (8, 16, 32)


def decode_rtmo(outputs: Mapping[str, Array], threshold: float, iou: float, most: int) -> DetectedPeople:
    """Decode people from `boxes` (M, 5) corners and score, and `points` (M, K, 3) x, y, score."""
    boxes, points = outputs["boxes"], outputs["points"]
    return _people(boxes[:, :4], boxes[:, 4], points, threshold, iou, most)


def decode_yolo(outputs: Mapping[str, Array], threshold: float, iou: float, most: int) -> DetectedPeople:
    """Decode people from `people` (5 + 3 K, A): centre, size, score, and x, y, score of each joint."""
    rows = outputs["people"].T
    half = 0.5 * rows[:, 2:4]
    boxes = np.concatenate([rows[:, :2] - half, rows[:, :2] + half], axis=1)
    return _people(boxes, rows[:, 4], rows[:, 5:].reshape(len(rows), -1, 3), threshold, iou, most)


def decode_yolo_end_to_end(outputs: Mapping[str, Array], threshold: float, most: int) -> DetectedPeople:
    """Decode people from `people` (M, 6 + 3 K): corners, score, class, joints.

    The network has suppressed overlaps already.
    """
    rows = outputs["people"]
    rows = rows[np.rint(rows[:, 5]) == 0]
    points = rows[:, 6:].reshape(len(rows), -1, 3)
    return _people(rows[:, :4], rows[:, 4], points, threshold, 1.0, most)


def decode_yolox(
    outputs: Mapping[str, Array], net_size: tuple[int, int], threshold: float, iou: float, most: int
) -> DetectedPeople:
    """Decode boxes from `people` (A, 5 + classes): raw centre, log size, objectness and class scores.

    The A rows are the cells of the grids of strides 8, 16 and 32, one grid after the other. Class 0 is the
    person.
    """
    rows = outputs["people"]
    cells, strides = _yolox_grid(net_size)
    centre = (rows[:, :2] + cells) * strides[:, None]
    half = 0.5 * np.exp(rows[:, 2:4]) * strides[:, None]
    boxes = np.concatenate([centre - half, centre + half], axis=1)
    return _people(boxes, rows[:, 4] * rows[:, 5], _none(len(rows)), threshold, iou, most)


def decode_detections(
    outputs: Mapping[str, Array], threshold: float, iou: float, most: int
) -> DetectedPeople:
    """Decode boxes from `boxes` (M, 5) corners and score; with `labels` (M,), only those of class 0."""
    boxes = outputs["boxes"]
    if "labels" in outputs:
        boxes = boxes[np.rint(outputs["labels"]) == 0]
    return _people(boxes[:, :4], boxes[:, 4], _none(len(boxes)), threshold, iou, most)


def _yolox_grid(net_size: tuple[int, int]) -> tuple[Array, Array]:
    """Return column and row (A, 2) of every cell, and its stride (A,)."""
    cells, strides = [], []
    for stride in YOLOX_STRIDES:
        rows, columns = np.mgrid[: net_size[0] // stride, : net_size[1] // stride]
        cells.append(np.stack([columns.ravel(), rows.ravel()], axis=1))
        strides.append(np.full(rows.size, stride))
    return np.concatenate(cells), np.concatenate(strides)


def _none(count: int) -> Array:
    return np.zeros((count, 0, 3))


def _people(
    boxes: Array, scores: Array, points: Array, threshold: float, iou: float, most: int
) -> DetectedPeople:
    """Return the people above the threshold, best first, without those that overlap a better one."""
    kept = np.flatnonzero((scores >= max(threshold, 1e-6)) & np.isfinite(boxes).all(axis=1))
    order = kept[np.argsort(-scores[kept], kind="stable")]
    if iou < 1.0:
        order = order[suppress_overlaps(boxes[order], scores[order], iou)]
    order = order[:most]
    return DetectedPeople(
        points[order, :, :2].astype(float),
        np.clip(points[order, :, 2], 0.0, 1.0).astype(float),
        np.clip(scores[order], 0.0, 1.0).astype(float),
        boxes[order].astype(float),
    )
