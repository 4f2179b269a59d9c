"""Quality of a calibration: predicted errors in the space of the target, coverage, and reasons for doubt."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.calibration.projection import OFFSET, POSE, derivatives
from panoptic_ros.calibration.solve import CalibratedRig
from panoptic_ros.calibration.target_poses import intrinsics_of

Array = np.ndarray
GRID = 7  # points per axis of the space in which errors are predicted
TAIL = 2.0  # percent of the target's points beyond each side of that space
CELLS = (4, 3)  # columns and rows of the cells of an image
# Limits of a good calibration (measured on simulated and real rigs with boards, see docs/notes).
GOOD_ERROR_M = 3e-3  # m, predicted error in the space of the target
GOOD_FOCAL = 3e-3  # relative, standard deviation of a focal length
GOOD_CENTRE_PX = 5.0  # px, standard deviation of the principal point
GOOD_NOISE_PX = 0.5  # px per axis
GOOD_VIEWS = 15
MOST_REJECTED = 0.1  # share of images left out that needs no mention
GOOD_COVERAGE = 0.6  # share of the cells of an image
GOOD_TILT_DEG = (30, 60)  # degrees, tilts of a target against the viewing direction that determine the lens
ASYNCHRONOUS_S = 0.025  # s, offset or spread of stamps beyond which a camera is not synchronous
REFUSED = 5.0  # times these limits: the calibration is not usable


class CameraQuality(NamedTuple):
    """Quality of one camera.

    Args:
        name: Its name.
        views: Number of views. points: Number of points in them. outliers: Points left out.
        rejected: Views of which most points were left out.
        noise_px: Residual, px per axis.
        coverage: Share of the cells of the image with points.
        focal_sd: Relative standard deviation of the focal length.
        centre_sd_px: Standard deviation, px, of the principal point.
        offset_s, offset_sd_s: Clock offset, s; 0 and 0 = not estimated.
        jitter_s: Standard deviation, s, of the time shifts of its images.
    """

    name: str
    views: int
    points: int
    outliers: int
    rejected: int
    noise_px: float
    coverage: float
    focal_sd: float
    centre_sd_px: float
    offset_s: float
    offset_sd_s: float
    jitter_s: float

    @property
    def asynchronous(self) -> bool:
        """Return whether the images of the camera are late by more than a synchronous camera's."""
        late = abs(self.offset_s) > ASYNCHRONOUS_S + 2.0 * self.offset_sd_s
        return late or self.jitter_s >= ASYNCHRONOUS_S


class Quality(NamedTuple):
    """Quality of a calibration.

    Args:
        cameras: One per camera.
        error_m: Root mean square, m, of the predicted errors in the space of the target.
        worst_m: 95th percentile, m, of these errors.
    """

    cameras: tuple[CameraQuality, ...]
    error_m: float
    worst_m: float


def quality_of(rig: CalibratedRig, scaled: bool = False) -> Quality:
    """Return the quality of a calibration.

    Args:
        scaled: Another measurement gives the scale, see `predicted_errors`.
    """
    errors = predicted_errors(rig, space_of(rig), scaled)
    seen, states = rig.seen, rig.state.cameras
    own = seen.cameras[seen.views]
    rejected = rig.rejected
    offsets = states.offsets - np.median(states.offsets)  # one late camera must not blame the others
    cameras = []
    for c, given in enumerate(rig.inputs):
        lens_sd = rig.sd(c, slice(POSE, POSE + 4))
        cameras.append(
            CameraQuality(
                given.name,
                int((np.diff(seen.starts)[seen.cameras == c] > 0).sum()),
                int((own == c).sum()),
                int(rig.outliers[c]),
                int(rejected[seen.cameras == c].sum()),
                float(rig.noise[c]),
                coverage_of(seen.pixels[own == c], given.size),
                float(lens_sd[:2].max() / states.lenses[c, 0]),
                float(lens_sd[2:].max()),
                float(offsets[c]),
                float(rig.sd(c, slice(OFFSET, OFFSET + 1))[0]),
                float(states.jitter[c]),
            )
        )
    return Quality(tuple(cameras), float(np.sqrt((errors**2).mean())), float(np.percentile(errors, 95.0)))


def covered_cells(pixels: Array, size: tuple[int, int]) -> Array:
    """Return whether the cells (rows, columns) of an image (width, height) hold one of the pixels (N, 2)."""
    columns, rows = np.clip((pixels / np.array(size) * CELLS).astype(int), 0, np.array(CELLS) - 1).T
    covered = np.zeros(CELLS[::-1], bool)
    covered[rows, columns] = True
    return covered


def coverage_of(pixels: Array, size: tuple[int, int]) -> float:
    """Return the share of the cells of an image (width, height) that hold one of the pixels (N, 2)."""
    return float(covered_cells(pixels, size).mean())


def space_of(rig: CalibratedRig) -> Array:
    """Return a grid (N, 3) m of the space in which the target was shown, in the frame of the first camera.

    Points that fewer than two cameras see are left out.
    """
    seen, targets = rig.seen, rig.state.targets
    block = seen.targets[seen.views]
    shown = np.einsum("mij,mj->mi", targets.rotations[block], seen.points) + targets.translations[block]
    middle = shown.mean(axis=0)
    axes = np.linalg.svd(shown - middle, full_matrices=False)[2]
    low, high = np.percentile((shown - middle) @ axes.T, [TAIL, 100.0 - TAIL], axis=0)
    steps = [np.linspace(a, b, GRID) for a, b in zip(low, high)]
    grid = np.stack(np.meshgrid(*steps, indexing="ij"), -1).reshape(-1, 3) @ axes + middle
    states = rig.state.cameras
    views = np.zeros(len(grid), np.int64)
    for c, given in enumerate(rig.inputs):
        intrinsics = intrinsics_of(states.lenses[c], given.model.fisheye)
        pixels, front = intrinsics.project(grid @ states.rotations[c].T + states.translations[c])
        with np.errstate(invalid="ignore"):
            views += front & ((pixels > 0.0) & (pixels < np.array(given.size))).all(axis=1)
    both = views >= 2
    space: Array = grid[both] if both.any() else grid
    return space


def predicted_errors(rig: CalibratedRig, points: Array, scaled: bool = False) -> Array:
    """Return the predicted errors (N,) m of points (N, 3) m that all cameras in view triangulate.

    Each is the standard deviation of the distance between a point and its triangulation from exact pixels,
    after the best rigid alignment of all points. It follows from the covariance by linear propagation.

    Args:
        scaled: The alignment includes the scale, because another measurement gives it.
    """
    states, size = rig.state.cameras, len(rig.covariance)
    gains = np.zeros((len(points), 3, size))
    for n, point in enumerate(points):
        information, pull = np.zeros((3, 3)), np.zeros((3, size))
        for c, given in enumerate(rig.inputs):
            pixel, by_camera, by_point = np.empty(2), np.empty((2, OFFSET)), np.empty((2, 3))
            if not derivatives(
                states.lenses[c],
                states.fisheye[c],
                states.rotations[c],
                states.translations[c],
                point[0],
                point[1],
                point[2],
                pixel,
                by_camera,
                by_point,
            ):
                continue
            if not ((pixel > 0.0) & (pixel < np.array(given.size))).all():
                continue
            information += by_point.T @ by_point
            rows = rig.index[c, :OFFSET]
            pull[:, rows[rows >= 0]] += by_point.T @ by_camera[:, rows >= 0]
        gains[n] = -np.linalg.pinv(information) @ pull
    flat = gains.reshape(-1, size)
    motions = _rigid_motions(points)
    if scaled:
        motions = np.column_stack([motions, (points - points.mean(axis=0)).reshape(-1)])
    basis = np.linalg.qr(motions)[0]
    flat = flat - basis @ (basis.T @ flat)
    variances = ((flat @ rig.covariance) * flat).sum(axis=1).reshape(-1, 3).sum(axis=1)
    errors: Array = np.sqrt(np.maximum(variances, 0.0))
    return errors


def _rigid_motions(points: Array) -> Array:
    """Return the displacements (3 N, 6) of points (N, 3) by three small rotations and three translations."""
    away = points - points.mean(axis=0)
    columns = [np.cross(axis, away).reshape(-1) for axis in np.eye(3)]
    columns += [np.tile(axis, (len(points), 1)).reshape(-1) for axis in np.eye(3)]
    return np.stack(columns, axis=1)


def doubts(quality: Quality, target: str = "board") -> list[str]:
    """Return one line per limit of a good calibration that is exceeded, with the remedy."""
    lines = []
    if quality.error_m > GOOD_ERROR_M:
        lines.append(
            f"positions are predicted to be wrong by {1e3 * quality.error_m:.1f} mm, more than "
            f"{1e3 * GOOD_ERROR_M:g} mm; show the {target} in more places, near each camera too"
        )
    for camera in quality.cameras:
        where = f"camera {camera.name}: "
        if camera.views < GOOD_VIEWS:
            lines.append(f"{where}{camera.views} images show the {target}; give at least {GOOD_VIEWS}")
        if camera.coverage < GOOD_COVERAGE:
            lines.append(
                f"{where}the {target} was shown in {camera.coverage:.0%} of the image; move it to the edges"
            )
        if camera.focal_sd > GOOD_FOCAL:
            lines.append(
                f"{where}the focal length is known to {camera.focal_sd:.1%} only; tilt the {target} by "
                f"{GOOD_TILT_DEG[0]} to {GOOD_TILT_DEG[1]} degrees and show it near the camera"
            )
        if camera.centre_sd_px > GOOD_CENTRE_PX:
            lines.append(
                f"{where}the principal point is known to {camera.centre_sd_px:.0f} px only; turn the "
                f"{target} about its normal and show it at all edges"
            )
        if camera.noise_px > GOOD_NOISE_PX:
            lines.append(
                f"{where}the residual is {camera.noise_px:.2f} px; check focus, motion blur and the shape of "
                f"the {target}"
            )
        if camera.rejected > MOST_REJECTED * camera.views:
            lines.append(
                f"{where}{camera.rejected} of {camera.views + camera.rejected} images contradict the others "
                f"and were left out; check for a second {target}, wrong points, or wrong stamps"
            )
        lines += _clock_doubts(camera, where)
    return lines


def _clock_doubts(camera: CameraQuality, where: str) -> list[str]:
    if not camera.asynchronous:
        return []
    return [
        f"{where}not synchronous: its images are {1e3 * abs(camera.offset_s):.0f} ms "
        f"{'older' if camera.offset_s < 0.0 else 'newer'} than their stamps against the others, "
        f"± {1e3 * camera.jitter_s:.0f} ms from image to image; synchronise it, or apply the clocks file"
    ]


def refusals(quality: Quality, target: str = "board") -> list[str]:
    """Return the reasons for which a calibration is not usable: limits that are exceeded several times."""
    lines = []
    if quality.error_m > REFUSED * GOOD_ERROR_M:
        lines.append(f"positions are predicted to be wrong by {1e3 * quality.error_m:.0f} mm")
    for camera in quality.cameras:
        if camera.focal_sd > REFUSED * GOOD_FOCAL:
            lines.append(
                f"camera {camera.name}: the focal length is known to {camera.focal_sd:.0%} only; tilt the "
                f"{target}"
            )
    return lines
