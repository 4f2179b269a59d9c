"""Scene of one instant as arrays for kernels: camera poses, 2D poses and visibility limits.

The 2D poses are gathered once, as flat arrays, and undistorted.
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
MIN_DEPTH = 0.05  # m, least depth of a point in front of a camera
OUTSIDE, HIDDEN, SEEN = 0, 1, 2  # visibility of a position in a view


class CameraPoses(NamedTuple):
    """Poses and delays of V cameras.

    Args:
        rotations: (V, 3, 3) of cam_from_world.
        translations: (V, 3) m of cam_from_world.
        delays: (V,) s, exposure of the image's middle row minus the instant; 0 where motion in between is
            neglected.
    """

    rotations: Array
    translations: Array
    delays: Array


class SceneObservations(NamedTuple):
    """All 2D joints of one instant: V views, D 2D poses ordered by view.

    Args:
        plane: (D, J, 2) undistorted normalised points.
        precision: (D, J) 1 / standard deviation on that plane, 0 = missing.
        views: (D,) view of each 2D pose.
        starts: (V + 1,) first 2D pose of each view.
        cams: Cameras of the views.
        lenses: (V,) records, see `camera_records`.
        sizes: (D,) sizes of the 2D poses: diagonals of their bounding boxes on the plane. Infinite where
            artefacts of image borders are excluded: 2D joints are then treated as observations even if
            the joint lies outside the image.
        delays: (D, J) s, exposure of the row of each 2D joint minus the instant, see `CameraPoses`.
    """

    plane: Array
    precision: Array
    views: Array
    starts: Array
    cams: CameraPoses
    lenses: Array
    sizes: Array
    delays: Array


class ViewVisibility(NamedTuple):
    """Fields of view and visibility limits of V views.

    Args:
        cameras: (V,) records, see `camera_records`.
        limits: See `limits_of`.
    """

    cameras: Array
    limits: Array


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """The 2D poses of one instant and the V cameras that observed them.

    Args:
        evidence: The 2D poses.
        precision: (D, J) 1 / standard deviation on the normalised plane, 0 = missing.
        mirror: (J,) joint on the other side.
        cams: Poses and delays of the views.
        centres: (V, 3) m, world, optical centres.
        focals: (V,) px.
        sight: Fields of view and visibility limits.
        sizes: (D,) sizes of the 2D poses, see `SceneObservations`.
        delays: (D, J) s of the 2D joints, see `SceneObservations`.
    """

    evidence: Evidence
    precision: Array
    mirror: Array
    cams: CameraPoses
    centres: Array
    focals: Array
    sight: ViewVisibility
    sizes: Array
    delays: Array

    @property
    def observations(self) -> SceneObservations:
        """Return the scene in the form that the joint solver's kernels take."""
        evidence = self.evidence
        return SceneObservations(
            evidence.plane,
            self.precision,
            evidence.view,
            evidence.starts,
            self.cams,
            self.sight.cameras,
            self.sizes,
            self.delays,
        )


def gather(
    detections: DetectionSet, arrays: RigArrays, skeleton: SkeletonModel, skeleton_hash: str, min_score: float
) -> Evidence:
    """Flatten, order and undistort the 2D poses of a set.

    Views follow the order of the rig. The 2D poses of a view are sorted by a key from their joints alone, so
    the order of the input does not matter. Derived joints are left out, because their 2D points are no
    observations.

    Args:
        min_score: joints with a lower score are treated as missing.

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
    """Return the time (D,) s for which optical flow propagated each 2D pose; 0 = detected in its image."""
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
                f"camera {record.camera}: detections in an image of {record.image_size}, but the rig "
                f"states {size}; rescale one of them"
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
    """Return the scene of a detection set and its evidence.

    Args:
        precision: (D, J) 1 / standard deviation on the normalised plane, 0 = missing.
        mirror: (J,) joint on the other side.
        borders: whether 2D joints may be artefacts of image borders.
    """
    rows, cams = evidence.cameras, cameras_of(evidence, arrays)
    views = [detections.views[slot] for slot in evidence.slots]
    sight = ViewVisibility(arrays.lenses[rows], limits_of(views))
    sizes = box_sizes(evidence.plane, evidence.scores) if borders else np.full(len(evidence.view), np.inf)
    focals, delays = arrays.focals[rows], joint_delays(views, evidence, arrays)
    return Scene(evidence, precision, mirror, cams, arrays.centres[rows], focals, sight, sizes, delays)


def cameras_of(evidence: Evidence, arrays: RigArrays) -> CameraPoses:
    """Return the poses and delays of the views."""
    rows = evidence.cameras
    delays = evidence.delays + arrays.middles[rows]
    return CameraPoses(arrays.rotations[rows], arrays.translations[rows], delays)


def joint_delays(views: Sequence[ViewDetections], evidence: Evidence, arrays: RigArrays) -> Array:
    """Return the delays (D, J) s of the 2D joints, see `SceneObservations`.

    Args:
        views: the views of the evidence, in its order.
    """
    lines = arrays.line_delays[evidence.cameras]
    delays = np.repeat(evidence.delays[evidence.view, None], evidence.scores.shape[1], axis=1)
    for v in np.flatnonzero(lines).tolist():
        own = slice(evidence.starts[v], evidence.starts[v + 1])
        delays[own] += lines[v] * np.nan_to_num(views[v].points[evidence.rows[own], :, 1])
    return delays


@njit(cache=True, error_model="numpy")
def box_sizes(plane, scores):
    """Return the diagonals (D,) of 2D poses' bounding boxes on the plane, without joints of score 0."""
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
    """Return precisions (D, J) on the plane for 2D joints with a common pixel noise.

    Args:
        noise: standard deviation of 2D joints, as a share of the image diagonal.
    """
    cameras = evidence.cameras[evidence.view]
    scale = arrays.focals[cameras] / (noise * arrays.diagonals[cameras])
    precision: Array = np.where(evidence.scores > 0.0, scale[:, None] * evidence.magnification, 0.0)
    return precision


def limits_of(views: Sequence[ViewDetections]) -> Array:
    """Return the visibility limits of V views in one array (V * 3 + cells,).

    The array begins with three numbers per view: index of the first cell of its limit (0 = none), columns,
    rows. Then come the cells of all views, m, row by row.
    """
    parts, end = [np.zeros(3 * len(views))], 3 * len(views)
    for v, view in enumerate(views):
        if view.limit is not None:
            rows, columns = view.limit.cells.shape
            parts[0][3 * v : 3 * v + 3] = end, columns, rows
            parts.append(_metres(view.limit))
            end += rows * columns
    return np.concatenate(parts)


@lru_cache(maxsize=256)  # limits of fixed occluders are the same at every instant
def _metres(limit: VisibilityLimit) -> Array:
    return limit.metres.ravel()


@inlined
def within(camera, limits, v, u, w, depth):
    """Return whether a depth in m at a pixel of view v, which has a limit, is within that limit."""
    start, columns, rows = int(limits[3 * v]), int(limits[3 * v + 1]), int(limits[3 * v + 2])
    i = min(int((u + 0.5) * (columns / camera.width)), columns - 1)
    k = min(int((w + 0.5) * (rows / camera.height)), rows - 1)
    return depth <= limits[start + k * columns + i]


@inlined
def pixel(camera, x, y):
    """Return the pixel, px, of a point of the plane at 1 m, and whether the lens shows the point."""
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
    """Return whether a point of the plane at 1 m lies outside the image."""
    if camera.left < x < camera.right and camera.top < y < camera.bottom:
        return False
    return inside_by(camera, x, y) < 0.0


@njit(cache=True, error_model="numpy")
def look(sight, v, x, y, depth):
    """Return whether a point is OUTSIDE of view v, HIDDEN from it or SEEN by it.

    Args:
        x, y: Point on the plane at 1 m.
        depth: m.
    """
    camera = sight.cameras[v]
    u, w, seen = pixel(camera, x, y)
    if not (seen and -0.5 <= u <= camera.width - 0.5 and -0.5 <= w <= camera.height - 0.5):
        return OUTSIDE
    if sight.limits[3 * v] == 0.0 or within(camera, sight.limits, v, u, w, depth):
        return SEEN
    return HIDDEN


@inlined
def seen_at(cams, v, x, shift, late):
    """Project a moving point into view v.

    Args:
        x: (3,) m, world, position at the instant.
        shift: (3,) m/s, velocity.
        late: s, exposure minus the instant.

    Returns:
        u, w: point on the plane at 1 m.
        depth: m; `MIN_DEPTH` for points that are unknown or not in front of the camera.
    """
    r, t = cams.rotations, cams.translations
    a, b, c = x[0] + shift[0] * late, x[1] + shift[1] * late, x[2] + shift[2] * late
    z = r[v, 2, 0] * a + r[v, 2, 1] * b + r[v, 2, 2] * c + t[v, 2]
    z = z if z > MIN_DEPTH else MIN_DEPTH
    u = (r[v, 0, 0] * a + r[v, 0, 1] * b + r[v, 0, 2] * c + t[v, 0]) / z
    w = (r[v, 1, 0] * a + r[v, 1, 1] * b + r[v, 1, 2] * c + t[v, 1]) / z
    return u, w, z


@njit(cache=True, error_model="numpy")
def look_at(position, cams, sight):
    """Return the visibility (V,) of a person (J, 3) m in each view, without motion.

    The result is SEEN if the view sees at least half of the known joints. It is HIDDEN if at least half are
    in the image, but fewer than half are seen. Otherwise it is OUTSIDE.
    """
    found, still = np.full(len(cams.delays), OUTSIDE, np.int64), np.zeros(3)
    known = 0
    for j in range(len(position)):
        known += np.isfinite(position[j, 0])
    for v in range(len(found)):
        seen = hidden = 0
        for j in range(len(position)):
            x, y, depth = seen_at(cams, v, position[j], still, 0.0)
            if depth > MIN_DEPTH:
                state = look(sight, v, x, y, depth)
                seen += state == SEEN
                hidden += state == HIDDEN
        if seen + hidden >= 0.5 * max(known, 1):
            found[v] = SEEN if seen >= 0.5 * max(known, 1) else HIDDEN
    return found
