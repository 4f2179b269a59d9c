"""One instant, ready for the kernels: where the cameras were, what they saw, and how far they see.

Its 2D people are gathered once, as flat arrays, and undistorted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import (
    AssociationSet,
    DetectionSet,
    Evidence,
    SkeletonModel,
    ViewDetections,
    VisibilityLimit,
)
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.errors import DataError
from panoptic_ros.geometry.lens_kernels import bent, bent_by_many, undistort_points
from panoptic_ros.kernels import inlined, njit

Array = np.ndarray
MIN_DEPTH = 0.05  # m
OUTSIDE, HIDDEN, SEEN = 0, 1, 2  # of a place and a view


class Cameras(NamedTuple):
    """Where V cameras are, and when each of them looked.

    rotations (V, 3, 3) and translations (V, 3) m: cam_from_world. delays (V,) s: stamp of the view less that
    of the instant, 0 where motion between them is not allowed for.
    """

    rotations: Array
    translations: Array
    delays: Array


class Observations(NamedTuple):
    """All 2D joints of one instant: V views, D 2D people ordered by view.

    plane (D, J, 2) undistorted normalised points. precision (D, J) 1 / standard deviation on that plane, 0 =
    missing. views (D,) of each 2D person. starts (V + 1,) first 2D person of each view. cams: of the views.
    lenses (V,), see `camera_records`. sizes (D,) of the 2D people, diagonals of their boxes on the plane; inf
    where 2D joints are taken for observations even if the joint lies outside of the image.
    """

    plane: Array
    precision: Array
    views: Array
    starts: Array
    cams: Cameras
    lenses: Array
    sizes: Array


class Sight(NamedTuple):
    """What V views see: their cameras (V,), see `camera_records`, and limits, see `limits_of`."""

    cameras: Array
    limits: Array


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """The 2D people of one instant and the V cameras that saw them.

    Args:
        evidence: the 2D people.
        precision: (D, J) 1 / standard deviation on the normalised plane, 0 = missing.
        mirror: (J,) the joint on the other side.
        cams: where the views were. centres: (V, 3) m, of the cameras in the world.
        focals: (V,) px. sight: how far the views see. sizes: (D,) of the 2D people, see `Observations`.
    """

    evidence: Evidence
    precision: Array
    mirror: Array
    cams: Cameras
    centres: Array
    focals: Array
    sight: Sight
    sizes: Array

    @property
    def observations(self) -> Observations:
        """The same for kernels that solve joints."""
        evidence = self.evidence
        return Observations(
            evidence.plane,
            self.precision,
            evidence.view,
            evidence.starts,
            self.cams,
            self.sight.cameras,
            self.sizes,
        )


def gather(
    detections: DetectionSet, arrays: RigArrays, skeleton: SkeletonModel, skeleton_hash: str, min_score: float
) -> Evidence:
    """Flatten, order and undistort the 2D people of a set.

    Views are in the order of the rig. The people of a view are in an order that depends on their joints
    alone. So the order of the input does not matter. Derived joints are left out: their 2D points are no
    observations.

    Args:
        min_score: joints of a lower score count as missing.

    Raises:
        DataError: on another skeleton, a camera that the rig lacks, or other image sizes.
    """
    _check(detections, arrays, skeleton, skeleton_hash)
    slots = sorted(range(len(detections.views)), key=lambda i: arrays.index[detections.views[i].camera])
    records = [detections.views[i] for i in slots]
    cameras = np.array([arrays.index[record.camera] for record in records], np.int64)
    counts = [len(record.points) for record in records]
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    view = np.repeat(np.arange(len(records)), counts)
    joints = len(skeleton)
    pixels = np.concatenate([np.empty((0, joints, 2)), *(record.points for record in records)])
    scores = np.concatenate([np.empty((0, joints)), *(record.scores for record in records)])
    usable = (scores > 0.0) & (scores >= min_score)
    for joint, _ in skeleton.derived:
        usable[:, joint] = False
    keys = np.where(usable[..., None], pixels, 0.0).sum(axis=(1, 2))
    order = np.lexsort((keys, view))
    pixels, usable, scores = pixels[order], usable[order], scores[order]
    plane, magnification, good = undistort_points(pixels, usable, cameras[view], arrays.lenses)
    delays = np.array([1e-9 * (record.stamp_ns - detections.stamp_ns) for record in records])
    return Evidence(
        cameras,
        np.array(slots, np.int64),
        starts,
        view,
        order - starts[view],
        plane,
        magnification,
        np.where(good, scores, 0.0),
        delays,
    )


def carried_ages(detections: DetectionSet, evidence: Evidence) -> Array:
    """For how long (D,) s each 2D person was carried by motion; 0 = seen in its image."""
    ages = np.zeros(len(evidence.rows))
    for v, slot in enumerate(evidence.slots.tolist()):
        carried = detections.views[slot].carried
        if carried is not None:
            own = slice(evidence.starts[v], evidence.starts[v + 1])
            ages[own] = carried[evidence.rows[own]]
    return ages


def _check(detections: DetectionSet, arrays: RigArrays, skeleton: SkeletonModel, skeleton_hash: str) -> None:
    """Raise DataError unless the set fits the rig and the skeleton."""
    if detections.skeleton_hash != skeleton_hash:
        raise DataError(
            f"detections of skeleton {detections.skeleton_hash}, but association works on "
            f"{skeleton.name} ({skeleton_hash}); configure one skeleton for all"
        )
    for record in detections.views:
        if record.camera not in arrays.index:
            raise DataError(
                f"detections of camera {record.camera!r}, which the rig lacks; it has "
                f"{', '.join(list(arrays.index)[:8])}"
            )
        if record.points.shape[1] != len(skeleton):
            raise DataError(
                f"camera {record.camera}: people of {record.points.shape[1]} joints, "
                f"skeleton {skeleton.name} has {len(skeleton)}"
            )
        if record.maps is not None and record.maps.joints.size and record.maps.joints.max() >= len(skeleton):
            raise DataError(
                f"camera {record.camera}: score maps of {record.maps.joints.max() + 1} joints, "
                f"skeleton {skeleton.name} has {len(skeleton)}"
            )
        size = arrays.cameras[arrays.index[record.camera]].image_size
        if record.image_size != size:
            raise DataError(
                f"camera {record.camera}: detections in an image of {record.image_size}, the rig says "
                f"{size}; rescale one of them"
            )


def check_association(
    item: AssociationSet, arrays: RigArrays, skeleton: SkeletonModel, skeleton_hash: str
) -> None:
    """Raise DataError unless associated people fit the rig and the skeleton of a later stage."""
    found, joints = item.detections.skeleton_hash, item.evidence.scores.shape[1]
    if found != skeleton_hash or joints != len(skeleton):
        raise DataError(
            f"people of skeleton {found} with {joints} joints in a stage that works on {skeleton.name} "
            f"({skeleton_hash}) with {len(skeleton)}; configure one skeleton for all"
        )
    for view in item.detections.views:
        if view.camera not in arrays.index:
            raise DataError(f"people of camera {view.camera!r}, which the rig lacks; configure one rig")
    if len(item.evidence.cameras) and item.evidence.cameras.max() >= len(arrays.cameras):
        raise DataError(
            f"people of camera number {item.evidence.cameras.max()}, but the rig has {len(arrays.cameras)}; "
            "configure one rig for all"
        )


def scene_of(
    detections: DetectionSet,
    evidence: Evidence,
    precision: Array,
    mirror: Array,
    arrays: RigArrays,
    borders: bool = False,
) -> Scene:
    """The scene of a detection set and its evidence.

    Args:
        borders: whether 2D joints may be artefacts of image borders.
    """
    rows, cams = evidence.cameras, cameras_of(evidence, arrays)
    views = [detections.views[slot] for slot in evidence.slots]
    sight = Sight(arrays.lenses[rows], limits_of(views))
    sizes = box_sizes(evidence.plane, evidence.scores) if borders else np.full(len(evidence.view), np.inf)
    return Scene(evidence, precision, mirror, cams, arrays.centres[rows], arrays.focals[rows], sight, sizes)


def cameras_of(evidence: Evidence, arrays: RigArrays) -> Cameras:
    """The cameras of the views."""
    rows = evidence.cameras
    return Cameras(arrays.rotations[rows], arrays.translations[rows], evidence.delays)


@njit(cache=True, error_model="numpy")
def box_sizes(plane, scores):
    """Return the diagonals (D,) of the boxes of 2D people on the plane; joints of score 0 do not count."""
    sizes = np.zeros(len(plane))
    for d in range(len(plane)):
        left = top = np.inf
        right = bottom = -np.inf
        for j in range(scores.shape[1]):
            if scores[d, j] > 0.0:
                left, right = min(left, plane[d, j, 0]), max(right, plane[d, j, 0])
                top, bottom = min(top, plane[d, j, 1]), max(bottom, plane[d, j, 1])
        if right >= left:
            sizes[d] = np.hypot(right - left, bottom - top)
    return sizes


def even_precision(evidence: Evidence, arrays: RigArrays, noise: float) -> Array:
    """Precisions (D, J) of 2D joints that all have one noise, as a share of the image's diagonal."""
    cameras = evidence.cameras[evidence.view]
    scale = arrays.focals[cameras] / (noise * arrays.diagonals[cameras])
    precision: Array = np.where(evidence.scores > 0.0, scale[:, None] * evidence.magnification, 0.0)
    return precision


def limits_of(views: Sequence[ViewDetections]) -> Array:
    """How far V views see, in one array (V * 3 + cells,).

    Of each view the first cell of its limit (0 = none), columns, rows; then the cells of all, m, row by row.
    """
    parts, end = [np.zeros(3 * len(views))], 3 * len(views)
    for v, view in enumerate(views):
        if view.limit is not None:
            rows, columns = view.limit.cells.shape
            parts[0][3 * v : 3 * v + 3] = end, columns, rows
            parts.append(_metres(view.limit))
            end += rows * columns
    return np.concatenate(parts)


@lru_cache(maxsize=256)  # the limits of occluders stay the same from instant to instant
def _metres(limit: VisibilityLimit) -> Array:
    return limit.metres.ravel()


@inlined
def within(camera, limits, v, u, w, depth):
    """Whether view v, which has a limit, sees as far as a depth in m at a pixel of its image."""
    start, columns, rows = int(limits[3 * v]), int(limits[3 * v + 1]), int(limits[3 * v + 2])
    i = min(int((u + 0.5) * (columns / camera.width)), columns - 1)
    k = min(int((w + 0.5) * (rows / camera.height)), rows - 1)
    return depth <= limits[start + k * columns + i]


@inlined
def pixel(camera, x, y):
    """Where a point of the plane at 1 m lies in the image, px, and whether the lens shows it."""
    if camera.many > 0.0:
        dx, dy, r2 = bent_by_many(camera, x, y)
    else:
        terms = (camera.k1, camera.k2, camera.p1, camera.p2, camera.k3, camera.k4)
        dx, dy, r2 = bent(terms, camera.fisheye > 0.0, x, y)
    return camera.fx * dx + camera.skew * dy + camera.cx, camera.fy * dy + camera.cy, r2 < camera.fold


@njit(cache=True, error_model="numpy")
def inside_by(camera, x, y):
    """Return the distance in px from a point of the plane at 1 m to the image border, negative outside.

    Points that the lens does not show are infinitely far outside.
    """
    u, w, seen = pixel(camera, x, y)
    if not seen:
        return -np.inf
    return min(u + 0.5, camera.width - 0.5 - u, w + 0.5, camera.height - 0.5 - w)


@njit(cache=True, error_model="numpy")
def is_outside(camera, x, y):
    """Whether a point of the plane at 1 m lies outside of the image."""
    if camera.left < x < camera.right and camera.top < y < camera.bottom:
        return False
    return inside_by(camera, x, y) < 0.0


@njit(cache=True, error_model="numpy")
def look(sight, v, x, y, depth):
    """Whether a point at x, y of the plane at 1 m, and a depth in m, is OUTSIDE of view v, HIDDEN or SEEN."""
    camera = sight.cameras[v]
    u, w, seen = pixel(camera, x, y)
    if not (seen and -0.5 <= u <= camera.width - 0.5 and -0.5 <= w <= camera.height - 0.5):
        return OUTSIDE
    if sight.limits[3 * v] == 0.0 or within(camera, sight.limits, v, u, w, depth):
        return SEEN
    return HIDDEN


@inlined
def seen_at(cams, v, x, shift):
    """Where view v sees a point (3,) m that moves by (3,) m/s: on the plane at 1 m; its depth, m.

    Of what is not in front of the camera, or not known, the depth is `MIN_DEPTH`.
    """
    r, t, late = cams.rotations, cams.translations, cams.delays[v]
    a, b, c = x[0] + shift[0] * late, x[1] + shift[1] * late, x[2] + shift[2] * late
    z = r[v, 2, 0] * a + r[v, 2, 1] * b + r[v, 2, 2] * c + t[v, 2]
    z = z if z > MIN_DEPTH else MIN_DEPTH
    u = (r[v, 0, 0] * a + r[v, 0, 1] * b + r[v, 0, 2] * c + t[v, 0]) / z
    w = (r[v, 1, 0] * a + r[v, 1, 1] * b + r[v, 1, 2] * c + t[v, 1]) / z
    return u, w, z


@njit(cache=True, error_model="numpy")
def look_at(position, cams, sight):
    """How each view (V,) sees a person (J, 3) m at the instant.

    SEEN if at least half of the known joints are in sight, HIDDEN if so many are in the image, else OUTSIDE.
    """
    found, still = np.full(len(cams.delays), OUTSIDE, np.int64), np.zeros(3)
    known = 0
    for j in range(len(position)):
        known += np.isfinite(position[j, 0])
    for v in range(len(found)):
        seen = hidden = 0
        for j in range(len(position)):
            x, y, depth = seen_at(cams, v, position[j], still)
            if depth > MIN_DEPTH:
                state = look(sight, v, x, y, depth)
                seen += state == SEEN
                hidden += state == HIDDEN
        if seen + hidden >= 0.5 * max(known, 1):
            found[v] = SEEN if seen >= 0.5 * max(known, 1) else HIDDEN
    return found
