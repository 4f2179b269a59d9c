"""Covariance that the uncertainty of a rig's calibration adds to triangulated points.

A calibration error is the same at every instant. As noise of measurements it would be averaged away, and
weights of views would change. So its covariance is added once, to finished results. Cameras are independent,
because `rig.json` stores no cross-covariances.

The error that a camera adds on the plane at 1 m is linear in the inverse depth: a0 + a1 / z. Its covariance
is C0 + C1 / z + C2 / z^2, tabulated over the image when the rig is known.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.domain import Camera
from panoptic_ros.domain.camera import POSE_AND_MATRIX
from panoptic_ros.geometry.symmetric import invert_symmetric
from panoptic_ros.kernels import njit

Array = np.ndarray
CELLS = 24  # cells per axis of a table: an image of 1920 px has cells of 80 px
WIDEST = (
    4.0  # border of a table on the plane at 1 m, 76 degrees off the axis; points farther out use the border
)
SLOPE = 1e-6  # step of numeric derivatives, on the plane and in distortion terms
MATRIX_TERMS = ((0, 0), (1, 1), (0, 2), (1, 2))  # fx, fy, cx, cy in a camera matrix
MIN_DEPTH = 0.05  # m; nearer points have no view


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationErrors:
    """Errors of C cameras of a rig on the plane at 1 m.

    Args:
        rows: Row of each camera by name.
        rotations, translations, focals: (C, 3, 3), (C, 3) m, (C,) px.
        corners, sizes: (C, 2) least corner of the table, and size of its cells, on the plane.
        tables: (C, CELLS, CELLS, 3, 4) covariances C0, C1, C2, each 2 x 2, in x and y order of cells.
    """

    rows: dict[str, int]
    rotations: Array
    translations: Array
    focals: Array
    corners: Array
    sizes: Array
    tables: Array

    @classmethod
    def of(cls, cameras: tuple[Camera, ...]) -> CalibrationErrors | None:
        """Return the errors of the cameras of a rig, or None if no camera states a covariance."""
        if all(camera.covariance is None for camera in cameras):
            return None
        poses = [camera.cam_from_world for camera in cameras]
        focals = np.array([0.5 * np.trace(camera.intrinsics.matrix[:2, :2]) for camera in cameras])
        corners, sizes, tables = zip(*(_table(camera) for camera in cameras))
        errors = cls(
            {camera.name: row for row, camera in enumerate(cameras)},
            np.array([pose.rotation for pose in poses]),
            np.array([pose.translation for pose in poses]),
            focals,
            np.array(corners),
            np.array(sizes),
            np.array(tables),
        )
        errors.covariances(np.zeros((1, 3)), np.zeros((1, len(cameras)), bool))  # compiles the kernel
        return errors

    def covariances(self, points: Array, used: Array) -> Array:
        """Return the covariances (N, 3, 3) m^2 of points (N, 3) m; 0 if fewer than two cameras see a point.

        Views have equal noise in pixels. Where fewer than two used views see a point, all views that see it
        stand for them: earlier instants or other joints placed the point.

        Args:
            points: World; NaN = missing, which gives 0.
            used: (N, C) whether a view contributed to the point.
        """
        found = np.zeros((len(points), 3, 3))
        _fill_covariances(
            np.array(points),  # records are read-only, which would compile a second kernel
            used,
            self.rotations,
            self.translations,
            self.focals,
            self.corners,
            self.sizes,
            self.tables,
            found,
        )
        return found

    def of_people(self, positions: Array, cameras: tuple[str, ...], persons: Array | None) -> Array:
        """Return the covariances (P, J, 3, 3) m^2 of the joints of people.

        Args:
            positions: (P, J, 3) m, NaN = missing.
            cameras: (V,) names of the views of the instant.
            persons: (P, V) 2D poses as in `ViewSources`, -1 = none; None = unknown.
        """
        people, joints = positions.shape[:2]
        used = np.zeros((people, len(self.focals)), bool)
        if persons is not None:
            used[:, [self.rows[name] for name in cameras]] = persons >= 0
        views = np.repeat(used, joints, axis=0)
        return self.covariances(positions.reshape(-1, 3), views).reshape(people, joints, 3, 3)


@njit(cache=True, error_model="numpy", nogil=True)
def _fill_covariances(points, used, rotations, translations, focals, corners, sizes, tables, found):
    """Write the covariances of `CalibrationErrors.covariances` to `found` (N, 3, 3), which is 0 beforehand.

    A (2, 3) are the slopes of a view's plane by the point, in units of its noise. E is the covariance of the
    plane. The covariance of a point is (sum A'A)^-1 (sum A'EA) (sum A'A)^-1.
    """
    count = len(focals)
    cells, inverse, plane = np.empty((count, 2), np.int64), np.empty(count), np.empty((count, 2))
    seen = np.empty(count, np.bool_)
    first, second = np.empty(3), np.empty(3)
    normal, middle, inverted = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        if not (np.isfinite(x) and np.isfinite(y) and np.isfinite(z)):
            continue
        visible, own = 0, 0
        for c in range(count):
            turn, move = rotations[c], translations[c]
            seen[c] = False
            depth = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z + move[2]
            if depth <= MIN_DEPTH:
                continue
            inverse[c] = 1.0 / depth
            inside = True
            for k in range(2):
                local = turn[k, 0] * x + turn[k, 1] * y + turn[k, 2] * z + move[k]
                plane[c, k] = local * inverse[c]
                place = (plane[c, k] - corners[c, k]) / sizes[c, k]
                inside = inside and 0.0 <= place <= CELLS
                cells[c, k] = min(int(place), CELLS - 1) if inside else 0
            if inside:
                seen[c] = True
                visible += 1
                own += used[n, c]
        if visible < 2:
            continue
        normal[:], middle[:] = 0.0, 0.0
        for c in range(count):
            if not seen[c] or (own >= 2 and not used[n, c]):
                continue
            turn, near, terms = rotations[c], inverse[c], tables[c, cells[c, 0], cells[c, 1]]
            information = focals[c] * focals[c]
            for k in range(3):
                first[k] = near * (turn[0, k] - plane[c, 0] * turn[2, k])
                second[k] = near * (turn[1, k] - plane[c, 1] * turn[2, k])
            xx = terms[0, 0] + near * (terms[1, 0] + near * terms[2, 0])
            xy = terms[0, 1] + near * (terms[1, 1] + near * terms[2, 1])
            yy = terms[0, 3] + near * (terms[1, 3] + near * terms[2, 3])
            square = information * information
            for i in range(3):
                across, down = (
                    square * (xx * first[i] + xy * second[i]),
                    square * (xy * first[i] + yy * second[i]),
                )
                for j in range(i + 1):
                    normal[i, j] += information * (first[i] * first[j] + second[i] * second[j])
                    middle[i, j] += across * first[j] + down * second[j]
        for i in range(3):
            for j in range(i):
                middle[j, i] = middle[i, j]
        invert_symmetric(normal, 1.0, inverted)
        for i in range(3):
            for j in range(i + 1):
                total = 0.0
                for k in range(3):
                    for m in range(3):
                        total += inverted[i, k] * middle[k, m] * inverted[m, j]
                found[n, i, j] = found[n, j, i] = total


def _table(camera: Camera) -> tuple[Array, Array, Array]:
    """Return the least corner and the cell size (2,) of a camera's table, and the table."""
    lens, (width, height) = camera.intrinsics, camera.image_size
    across, down = np.linspace(-0.5, width - 0.5, CELLS + 1), np.linspace(-0.5, height - 0.5, CELLS + 1)
    image = lens.undistort(np.stack(np.meshgrid(across, down), axis=-1)).reshape(-1, 2)
    image = image[np.isfinite(image).all(axis=1)]
    low, high = np.clip(image.min(axis=0), -WIDEST, WIDEST), np.clip(image.max(axis=0), -WIDEST, WIDEST)
    size = (high - low) / CELLS
    if camera.covariance is None:
        return low, size, np.zeros((CELLS, CELLS, 3, 4))
    middles = low + size * (np.moveaxis(np.indices((CELLS, CELLS)), 0, -1) + 0.5)
    radii = np.linalg.norm(middles, axis=-1, keepdims=True)
    fold = 0.95 * min(lens.radius_limit, 1e3)
    plane = (middles * np.minimum(1.0, fold / np.maximum(radii, 1e-9))).reshape(-1, 2)
    near, far = _slopes(camera, plane)
    spread = camera.covariance
    mixed = near @ spread @ far.transpose(0, 2, 1)
    terms = near @ spread @ near.transpose(0, 2, 1), mixed + mixed.transpose(0, 2, 1)
    table = np.stack([*terms, far @ spread @ far.transpose(0, 2, 1)], axis=1)
    return low, size, table.reshape(CELLS, CELLS, 3, 4)


def _slopes(camera: Camera, plane: Array) -> tuple[Array, Array]:
    """Return the slopes a0 and a1 (N, 2, M) of the error on plane points (N, 2) by the M terms."""
    lens = camera.intrinsics
    near, far = np.zeros((2, len(plane), 2, POSE_AND_MATRIX + len(lens.distortion)))
    (x, y), one, nil = plane.T, np.ones(len(plane)), np.zeros(len(plane))
    flat = np.stack([np.stack([one, nil, -x], -1), np.stack([nil, one, -y], -1)], axis=1)
    points = np.stack([x, y, one], axis=-1)
    for axis, unit in enumerate(np.eye(3)):
        near[:, :, axis] = np.einsum("nij,nj->ni", flat, np.cross(unit, points))
        far[:, :, axis] = flat @ -np.cross(unit, camera.cam_from_world.translation)
        far[:, :, 3 + axis] = flat @ unit
    bent = lens.distort(plane)
    by_plane = np.stack(
        [
            (lens.distort(plane + step) - lens.distort(plane - step)) / (2.0 * SLOPE)
            for step in SLOPE * np.eye(2)
        ],
        axis=-1,
    )
    straight = np.linalg.inv(lens.matrix[:2, :2] @ by_plane)  # plane per pixel
    for k, (row, column) in enumerate(MATRIX_TERMS):
        pixels = np.zeros_like(plane)
        pixels[:, row] = bent[:, row] if column < 2 else 1.0
        near[:, :, 6 + k] = (straight @ pixels[..., None])[..., 0]
    for k, step in enumerate(SLOPE * np.eye(len(lens.distortion))):
        both = [
            replace(lens, distortion=lens.distortion + sign * step).distort(plane) for sign in (1.0, -1.0)
        ]
        change = (both[0] - both[1]) @ lens.matrix[:2, :2].T / (2.0 * SLOPE)
        near[:, :, POSE_AND_MATRIX + k] = (straight @ change[..., None])[..., 0]
    return near, far
