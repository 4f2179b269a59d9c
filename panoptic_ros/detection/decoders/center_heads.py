"""Decoder of centre heads: MoveNet MultiPose, which is CenterNet with one map per joint.

It follows Zhou, Wang, Krähenbühl, "Objects as Points", 2019, and MoveNet's own post-processing. A person is a
local maximum (5 x 5) of the centre map. The network regresses the joints from there. Each joint is the cell
with the best weighted score near the regressed place. The offset that is regressed in that cell is added. The
weight is exp(-d^2 / variance), d being the distance in cells. Only cells in the person's box count. A box
that contains no cell, or lies beyond the border, keeps the next cell.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from panoptic_ros.detection.decoders.center_kernels import people_of
from panoptic_ros.detection.people import DetectedPeople, no_people

Array = np.ndarray
SPREAD = 0.3  # squared width of the search for a joint, in cells per cell of the map's shorter side
HEADS = ("center", "heat", "regress", "offset", "box_scale", "box_offset")


def decode_center_heads(
    heads: Mapping[str, Array],
    stride: int,
    max_people: int,
    threshold: float,
    variance: float | None = None,
) -> DetectedPeople:
    """Decode the people of one image, in px of the network input; their origin is the image's corner.

    Args:
        heads: `center` (1, h, w) and `heat` (K, h, w) in 0..1; `regress` and `offset` (2 K, h, w),
            `box_scale` and `box_offset` (2, h, w) in cells, y before x.
        stride: px of the network input per cell.
        threshold: People with lower scores are dropped.
        variance: Squared width of the search for a joint, cells^2. None: from the size of the map, which then
            must show the whole image.
    """
    arrays = {role: np.ascontiguousarray(heads[role], np.float32) for role in HEADS}
    joint_count, rows, columns = arrays["heat"].shape
    variance = SPREAD * min(rows, columns) if variance is None else variance
    points, scores, person_scores, boxes = people_of(
        (arrays["center"][0], *(arrays[role] for role in HEADS[1:])), max_people, threshold, float(variance)
    )
    if not len(points):
        return no_people(joint_count)
    order = np.argsort(-person_scores, kind="stable")
    return DetectedPeople(stride * points, np.clip(scores, 0.0, 1.0), person_scores, stride * boxes).select(
        order
    )


def warm_up() -> None:
    """Compile the decoder."""
    heads = {role: np.zeros((2, 1, 1), np.float32) for role in HEADS}
    heads["heat"] = np.ones((1, 1, 1), np.float32)
    heads["center"] = heads["heat"]
    decode_center_heads(heads, 1, 1, 0.1)
