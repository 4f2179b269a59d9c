"""Skeletons and detections drawn into the camera images."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from panoptic_ros.domain import Camera, JointState, SkeletonModel, TrackedPoseSet, ViewDetections
from panoptic_ros.errors import DataError
from panoptic_ros.io.colors import bgr_of
from panoptic_ros.view.body_drawing import ShapedBodies, draw_bodies

Array = np.ndarray
# straight pieces per bone, because lens distortion bends it and a part may lie behind the camera
BONE_PIECES = 8
FAR = 1e6  # px; pieces with an end beyond this are not drawn
DETECTION_COLOR = (225, 225, 225)
EDGE_COLOR = (20, 20, 20)
FONT = cv2.FONT_HERSHEY_SIMPLEX
SUBPIXEL_BITS = 4


def draw_view(
    image: Array,
    camera: Camera,
    poses: TrackedPoseSet | None,
    skeleton: SkeletonModel,
    detections: ViewDetections | None = None,
    *,
    scale: float = 1.0,
    bodies: ShapedBodies | None = None,
) -> Array:
    """Draw skeletons into a copy of one camera image, reprojected with lens distortion.

    Each id has a colour and a number. Measured joints are discs, predicted joints are rings, filled joints
    are squares. A bone is thin unless both ends are measured. The detector's 2D poses are thin grey lines. A
    person with a body is drawn as its surface, without bones and joints.

    Args:
        image: BGR image (H, W, 3) uint8 of the camera's calibrated size.
        poses: Tracked poses. None or an empty set draws the detections only.
        bodies: Bodies of this instant.
        scale: Size of the result relative to the image. Drawing after resizing keeps lines sharp.

    Returns:
        Image (round(scale H), round(scale W), 3) uint8.

    Raises:
        DataError: If image, camera, poses and skeleton do not fit each other.
    """
    if (image.shape[1], image.shape[0]) != camera.image_size:
        raise DataError(
            f"camera {camera.name}: image {image.shape[1]}x{image.shape[0]}, "
            f"calibrated {camera.image_size[0]}x{camera.image_size[1]}"
        )
    for what in (poses, detections):
        if what is not None and what.skeleton_hash != skeleton.hash:
            raise DataError(f"poses or detections of skeleton {what.skeleton_hash}, drawing {skeleton.name}")
    canvas = _resized(image, scale)
    if detections is not None:
        _draw_detections(canvas, detections, skeleton, scale)
    there = [] if bodies is None else [body.id for body in bodies.bodies]
    if bodies is not None:
        draw_bodies(canvas, camera, bodies, [bgr_of(number) for number in there], scale)
    if poses is not None:
        pieces = _bone_pieces(camera, poses, skeleton)
        pixels, _ = camera.project(poses.positions)
        for person, identity in enumerate(poses.ids):
            if int(identity) in there:
                continue
            _draw_bones(canvas, pieces[person], poses.states[person], skeleton, bgr_of(identity), scale)
            _draw_joints(canvas, pixels[person], poses.states[person], bgr_of(identity), scale)
        for person, identity in enumerate(poses.ids):
            _draw_label(canvas, pixels[person], skeleton.head, f"{identity}", bgr_of(identity), scale)
    return canvas


def draw_text(canvas: Array, text: str, corner: tuple[int, int], size: float, color: Sequence[int]) -> None:
    """Draw outlined text with its lower left end at `corner` (px), shifted to stay inside the image."""
    weight = max(1, round(2 * size))
    (width, height), base = cv2.getTextSize(text, FONT, size, weight)
    x = int(np.clip(corner[0], 2, max(2, canvas.shape[1] - width - 2)))
    y = int(np.clip(corner[1], height + 2, max(height + 2, canvas.shape[0] - base - 1)))
    cv2.putText(canvas, text, (x, y), FONT, size, (0, 0, 0), weight + 2, cv2.LINE_AA)
    cv2.putText(canvas, text, (x, y), FONT, size, tuple(color), weight, cv2.LINE_AA)


def _resized(image: Array, scale: float) -> Array:
    if scale == 1.0:
        return np.array(image)
    size = (max(1, round(scale * image.shape[1])), max(1, round(scale * image.shape[0])))
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR)


def _stroke(canvas: Array) -> float:
    """Return the bone width in px, proportional to the image size so that pictures of any size look alike."""
    width: float = max(2.0, min(canvas.shape[:2]) / 220.0)
    return width


def _bone_pieces(camera: Camera, poses: TrackedPoseSet, skeleton: SkeletonModel) -> Array:
    """Return pixels (P, B, BONE_PIECES + 1, 2) along the bones, NaN where they cannot be projected."""
    parents, children = (list(side) for side in zip(*skeleton.bones))
    start, end = poses.positions[:, parents], poses.positions[:, children]
    along = np.linspace(0.0, 1.0, BONE_PIECES + 1)[:, None]
    return camera.project(start[:, :, None] * (1.0 - along) + end[:, :, None] * along)[0]


def _draw_bones(
    canvas: Array, pieces: Array, states: Array, skeleton: SkeletonModel, color: Sequence[int], scale: float
) -> None:
    stroke = _stroke(canvas)
    for bone, (parent, child) in enumerate(skeleton.bones):
        solid = states[parent] == JointState.MEASURED and states[child] == JointState.MEASURED
        width = stroke if solid else 0.5 * stroke
        # a dark edge makes the bone visible on any background
        _draw_line(canvas, pieces[bone], EDGE_COLOR, width + 2.0, scale)
        _draw_line(canvas, pieces[bone], color, width, scale)


def _draw_line(canvas: Array, pixels: Array, color: Sequence[int], width: float, scale: float) -> None:
    """Draw a line through pixels (N, 2) of the unscaled image, with gaps at NaN and beyond `FAR`."""
    near = (np.abs(pixels) < FAR).all(-1)  # False for NaN
    fixed = _fixed_point(np.where(near[:, None], pixels, 0.0), scale)
    for i in np.flatnonzero(near[:-1] & near[1:]):
        a, b = (int(fixed[i, 0]), int(fixed[i, 1])), (int(fixed[i + 1, 0]), int(fixed[i + 1, 1]))
        cv2.line(canvas, a, b, tuple(color), max(1, round(width)), cv2.LINE_AA, SUBPIXEL_BITS)


def _draw_joints(canvas: Array, pixels: Array, states: Array, color: Sequence[int], scale: float) -> None:
    radius = 1.4 * _stroke(canvas)
    ring = max(1, round(0.6 * _stroke(canvas)))
    margin = 2.0 * radius / scale
    limits = np.array([canvas.shape[1], canvas.shape[0]]) / scale + margin
    inside = ((pixels > -margin) & (pixels < limits)).all(-1)
    for joint in np.flatnonzero(inside):
        x, y = (int(value) for value in _fixed_point(pixels[joint], scale))
        size = round(radius * 2**SUBPIXEL_BITS)
        if states[joint] == JointState.FILLED:
            corner, other = (x - size, y - size), (x + size, y + size)
            cv2.rectangle(canvas, corner, other, tuple(color), ring, cv2.LINE_AA, SUBPIXEL_BITS)
        else:
            fill = cv2.FILLED if states[joint] == JointState.MEASURED else ring
            cv2.circle(canvas, (x, y), size, tuple(color), fill, cv2.LINE_AA, SUBPIXEL_BITS)


def _draw_label(
    canvas: Array, pixels: Array, head: int, text: str, color: Sequence[int], scale: float
) -> None:
    """Draw the id above the head, or above the highest visible joint if the head is outside the image."""
    shown = (pixels + 0.5) * scale - 0.5
    inside: Array = np.all((shown >= 0) & (shown < canvas.shape[1::-1]), axis=-1)
    if not inside.any():
        return
    x, y = shown[head] if inside[head] else shown[inside][shown[inside, 1].argmin()]
    stroke = _stroke(canvas)
    draw_text(canvas, text, (round(x - 4 * stroke), round(y - 14 * stroke)), 0.45 * stroke, color)


def _draw_detections(
    canvas: Array, detections: ViewDetections, skeleton: SkeletonModel, scale: float
) -> None:
    for points in detections.points:
        for parent, child in skeleton.bones:
            _draw_line(canvas, points[[parent, child]], DETECTION_COLOR, 1.0, scale)


def _fixed_point(pixels: Array, scale: float) -> Array:
    """Return OpenCV fixed-point coordinates, in the scaled image, of pixels of the unscaled image."""
    fixed_point: Array = np.round(((pixels + 0.5) * scale - 0.5) * 2**SUBPIXEL_BITS)
    return fixed_point
