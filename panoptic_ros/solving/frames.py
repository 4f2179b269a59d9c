"""Collect the 2D poses of every camera frame at its own timestamp, undistorted once."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.domain import DetectionSet, SkeletonModel
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.solving.scene import gather

Array = np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class CameraFrame:
    """2D poses of one image.

    Args:
        camera: index into the rig.
        stamp_ns: (ns) timestamp on the camera's own clock.
        plane: (D, J, 2) undistorted normalised points.
        scores: (D, J), 0 where missing.
        heights: (D, J) px, row of the image in which each joint was detected.
    """

    camera: int
    stamp_ns: int
    plane: Array
    scores: Array
    heights: Array


def camera_frames(
    sets: Iterable[DetectionSet], arrays: RigArrays, skeleton: SkeletonModel, every: int = 1
) -> list[CameraFrame]:
    """Return the frames of detection sets, in the order of the sets and of the rig.

    Args:
        every: take one frame of each camera per `every` sets. Cameras take turns.

    Raises:
        DataError: see `solving.scene.gather`.
    """
    frames = []
    for k, item in enumerate(sets):
        if every > 1:
            due = [view for view in item.views if (k + arrays.index.get(view.camera, 0)) % every == 0]
            item = replace(item, views=tuple(due))
        evidence = gather(item, arrays, skeleton, skeleton.hash, 0.0)
        for v, camera in enumerate(evidence.cameras):
            rows = slice(evidence.starts[v], evidence.starts[v + 1])
            view = item.views[evidence.slots[v]]
            heights = np.nan_to_num(view.points[evidence.rows[rows], :, 1])
            frames.append(
                CameraFrame(int(camera), view.stamp_ns, evidence.plane[rows], evidence.scores[rows], heights)
            )
    return frames
