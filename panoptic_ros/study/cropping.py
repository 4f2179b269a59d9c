"""Central windows of images, so that image borders cut people."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from panoptic_ros.domain import Camera, DetectionSet, Rig, ViewDetections, ViewFrame
from panoptic_ros.evaluation import SkeletonFrame, SkeletonSequence

Array = np.ndarray
Shares = tuple[float, float]  # width and height of a window, as shares of the image
HALF: Shares = (0.5, 1.0)  # as `crop_capture.py` of the benchmark's recipes
# a person counts if this number of cameras shows more than this share of the joints
SEEN_SHARE, SEEN_BY = 1.0 / 3.0, 2


def window(camera: Camera, shares: Shares) -> tuple[int, int, int, int]:
    """Return left, top, width and height (px) of the central window of an image."""
    (width, height), (across, down) = camera.image_size, shares
    w, h = int(width * across) // 2 * 2, int(height * down) // 2 * 2
    return (width - w) // 2, (height - h) // 2, w, h


def cropped_rig(rig: Rig, shares: Shares) -> Rig:
    """Return the rig of the central windows of the images."""
    return replace(rig, cameras=tuple(_cropped(camera, shares) for camera in rig.cameras))


def _cropped(camera: Camera, shares: Shares) -> Camera:
    left, top, width, height = window(camera, shares)
    matrix = camera.intrinsics.matrix.copy()
    matrix[:2, 2] -= left, top
    return replace(camera, image_size=(width, height), intrinsics=replace(camera.intrinsics, matrix=matrix))


def cropped_images(
    instants: Iterable[list[ViewFrame]], rig: Rig, shares: Shares
) -> Iterator[list[ViewFrame]]:
    """Yield the central windows of the images of the cameras of `rig`."""
    windows = {camera.name: window(camera, shares) for camera in rig.cameras}
    for frames in instants:
        yield [_cut(frame, windows[frame.camera]) for frame in frames]


def _cut(frame: ViewFrame, place: tuple[int, int, int, int]) -> ViewFrame:
    left, top, width, height = place
    return replace(frame, image=np.ascontiguousarray(frame.image[top : top + height, left : left + width]))


def cropped_people(item: DetectionSet, rig: Rig, shares: Shares) -> DetectionSet:
    """Return the 2D poses as a detector without artefacts would report them in the central windows.

    2D joints outside of the window and score maps are removed.

    Args:
        rig: Rig of the whole images.
    """
    cameras = {camera.name: camera for camera in rig.cameras}
    return replace(item, views=tuple(_inside(view, cameras[view.camera], shares) for view in item.views))


def _inside(view: ViewDetections, camera: Camera, shares: Shares) -> ViewDetections:
    left, top, width, height = window(camera, shares)
    points = view.points - np.array([left, top], view.points.dtype)
    shown = (points >= -0.5).all(axis=-1) & (points <= np.array([width, height]) - 0.5).all(axis=-1)
    shown &= view.scores > 0.0
    points[~shown] = np.nan
    rows = shown.any(axis=1)
    return replace(
        view,
        image_size=(width, height),
        points=points[rows],
        scores=np.where(shown, view.scores, 0.0)[rows].astype(view.scores.dtype),
        person_scores=view.person_scores[rows],
        maps=None,
        carried=None if view.carried is None else view.carried[rows],
    )


def cropped_truth(truth: SkeletonSequence, rig: Rig) -> SkeletonSequence:
    """Mark true skeletons as ignored if fewer than `SEEN_BY` cameras show a third of their joints.

    Args:
        rig: Rig of the windows.
    """
    return replace(truth, frames=tuple(_with_ignored(frame, rig) for frame in truth.frames))


def _with_ignored(frame: SkeletonFrame, rig: Rig) -> SkeletonFrame:
    known = np.isfinite(frame.positions[..., 0])
    places, count = np.nan_to_num(frame.positions), np.maximum(known.sum(axis=1), 1)
    shares = [(camera.sees(places) & known).sum(axis=1) / count for camera in rig.cameras]
    seldom = (np.array(shares) > SEEN_SHARE).sum(axis=0) < SEEN_BY
    return replace(frame, ignored=frame.ignored | seldom)
