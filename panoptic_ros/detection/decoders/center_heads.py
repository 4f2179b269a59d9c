"""People from centre heads: MoveNet MultiPose, which is CenterNet with a map per joint.

Zhou, Wang, Krähenbühl, "Objects as Points", 2019, and MoveNet's own post-processing: a person is a
peak of the centre map; from there joints are regressed; each joint is then the cell near the
regressed place that has the best score, moved by the offset that is regressed there.
"""
from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np

from panoptic_ros.detection.people import People, no_people

Array = np.ndarray
SPREAD = 0.3  # squared width of the search for a joint, in cells per cell of the map's shorter side
COUNTED = 0.127  # joints above this make up a person's score


def decode_center_heads(
    heads: Mapping[str, Array], stride: int, max_people: int, threshold: float,
    variance: float | None = None,
) -> People:  # fmt: skip
    """The people of one image, in net px told from the image's corner.

    Args:
        heads: `center` (1, h, w) and `heat` (K, h, w) in 0..1; `regress` and `offset` (2 K, h, w),
            `box_scale` and `box_offset` (2, h, w) in cells, y before x.
        threshold: people below this score are left out.
        variance: squared width of the search for a joint, cells^2; None: by the size of the map, which is
            that of the image.
    """
    center, heat = heads["center"][0], heads["heat"]
    joint_count, rows, columns = heat.shape
    offset = heads["offset"].reshape(joint_count, 2, rows, columns)
    variance = SPREAD * min(rows, columns) if variance is None else variance
    joints, scores, person_scores, boxes = [], [], [], []
    for y, x in _peaks(center, max_people, threshold):
        guess = heads["regress"][:, y, x].reshape(joint_count, 2) + (y, x)
        box = _box(heads, y, x, (rows, columns))
        cells, score = _best_cells(heat, guess, box, variance)
        own = offset[np.arange(joint_count), :, cells[:, 0], cells[:, 1]]
        counted = score > COUNTED
        total = float(center[y, x]) * float(score[counted].sum()) / max(int(counted.sum()), 1)
        if total < threshold:
            continue
        joints.append(stride * (cells + own)[:, ::-1])
        scores.append(score)
        person_scores.append(total)
        boxes.append(stride * box[[1, 0, 3, 2]])
    if not joints:
        return no_people(joint_count)
    order = np.argsort(-np.array(person_scores), kind="stable")
    return People(
        np.array(joints, float), np.clip(scores, 0.0, 1.0).astype(float), np.array(person_scores),
        np.array(boxes, float),
    ).select(order)  # fmt: skip


def _peaks(center: Array, count: int, threshold: float) -> list[tuple[int, int]]:
    """Row and column of the best local maxima (5 x 5) of the centre map, best first."""
    highest = cv2.dilate(center, np.ones((5, 5), np.uint8))
    found = np.flatnonzero((center >= highest) & (center >= threshold))
    best = found[np.argsort(-center.ravel()[found], kind="stable")][:count]
    return [divmod(int(cell), center.shape[1]) for cell in best]


def _box(heads: Mapping[str, Array], y: int, x: int, size: tuple[int, int]) -> Array:
    """Top, left, bottom, right in cells, within the map."""
    half = 0.5 * np.maximum(heads["box_scale"][:, y, x], 0.0)
    middle = heads["box_offset"][:, y, x] + (y, x)
    boxes: Array = np.clip(np.concatenate([middle - half, middle + half]), 0.0, [*size, *size])
    return boxes


def _best_cells(heat: Array, guess: Array, box: Array, variance: float) -> tuple[Array, Array]:
    """For each joint the cell (K, 2) inside the box with the best score weighted by closeness.

    The weight is exp(-d^2 / variance), d the distance in cells to the guess; also gives the
    weighted scores (K,). A box between cells, or beyond the border, has the next cell.
    """
    rows, columns = heat.shape[1:]
    top, left = np.minimum(np.ceil(box[:2]).astype(int), (rows - 1, columns - 1))
    bottom, right = np.maximum(np.ceil(box[2:]).astype(int), (top + 1, left + 1))
    weight_y = np.exp(-((np.arange(top, bottom) - guess[:, :1]) ** 2) / variance)
    weight_x = np.exp(-((np.arange(left, right) - guess[:, 1:]) ** 2) / variance)
    weighted = heat[:, top:bottom, left:right] * weight_y[:, :, None] * weight_x[:, None, :]
    flat = weighted.reshape(len(heat), -1)
    best = flat.argmax(axis=1)
    cells = np.stack(np.divmod(best, right - left), axis=1) + (top, left)
    return cells, flat[np.arange(len(flat)), best]
