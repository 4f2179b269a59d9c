"""Calibrate cameras with known intrinsics from images of a projected or printed random pattern."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from panoptic_ros.calibration.lens_start import LensModel
from panoptic_ros.calibration.pattern.features import ImageFeatures, features_of, matched
from panoptic_ros.calibration.pattern.solve import calibrate_pattern
from panoptic_ros.calibration.pattern.tracks import PatternSightings, tracks_of
from panoptic_ros.calibration.quality import quality_of
from panoptic_ros.domain import Rig
from panoptic_ros.errors import CalibrationError, UsageError
from panoptic_ros.running.calibration.calibrate import BoardCalibration, input_of, without_floor
from panoptic_ros.running.calibration.recorded_board import BoardRecording
from panoptic_ros.running.calibration.recorded_images import open_images
from panoptic_ros.stage import Progress, part_of

Array = np.ndarray
MOST_SCENES = 20  # images of a camera, evenly spaced, that are used
ONE_PLACE_M = 1e-3  # m, span of cameras whose poses are missing
NEIGHBOURS = 12  # cameras that look most alike, whose images are matched if poses are known


def calibrate_from_pattern(
    path: Path, known: Rig | None, distance: tuple[str, str, float] | None, refine: bool, progress: Progress
) -> BoardCalibration:
    """Return the calibration of the cameras of a folder or bag.

    Images of the same number show the same scene in all cameras.

    Args:
        known: Cameras with known intrinsics, which are refined.
        distance: Names of two cameras and their measured distance, m.
        refine: The poses of `known` are approximately right.

    Raises:
        UserError: if the recording does not give a calibration.
    """
    if known is None:
        raise UsageError(
            "a pattern needs known lenses: give --intrinsics RIG, e.g. from a board before each camera"
        )
    if distance is None:
        raise UsageError(
            "a pattern does not give the scale: give --distance CAM_A,CAM_B=M, the measured distance of two "
            "lenses"
        )
    if refine and np.ptp(known.stack().centres, axis=0).max() < ONE_PLACE_M:
        raise UsageError("--refine needs poses, and --intrinsics gives none; leave --refine out")
    recording, sightings = _read_scenes(path, known, refine, part_of(progress, 0.0, 0.6))
    names = recording.names
    if unknown := [name for name in distance[:2] if name not in names]:
        raise UsageError(f"--distance: no camera {unknown[0]}; cameras are {', '.join(names)}")
    inputs = [input_of(name, size, LensModel(), known) for name, size in zip(names, recording.sizes)]
    tape = (names.index(distance[0]), names.index(distance[1]), distance[2])
    poses = [known.camera(name).cam_from_world for name in names] if refine else None
    solved = calibrate_pattern(inputs, sightings, tape, part_of(progress, 0.6, 1.0), poses)
    return without_floor("pattern", None, recording, solved, quality_of(solved, scaled=True))


def _read_scenes(
    path: Path, known: Rig, near: bool, progress: Progress
) -> tuple[BoardRecording, PatternSightings]:
    """Return the recording, and the points of the pattern in all scenes.

    Args:
        near: Match images only of cameras that look alike, by the poses of `known`.

    Raises:
        UserError: if a camera has no known lens, or fewer images than others.
    """
    parts: list[PatternSightings] = []
    pictures: dict[int, tuple[int, Array]] = {}
    stamps: list[int] = []
    with open_images(path) as recorded:
        names = tuple(source.camera for source in recorded.sources)
        sizes = tuple(source.image_size for source in recorded.sources)
        if missing := [name for name in names if name not in known.names]:
            raise CalibrationError(
                f"a pattern needs known lenses: --intrinsics has no camera {', '.join(missing)}; add "
                f"{'them' if len(missing) > 1 else 'it'}, or move the images away"
            )
        rig = known.subset(names)
        counts = [source.frame_count or 0 for source in recorded.sources]
        if max(counts) != min(counts):
            raise CalibrationError(
                f"camera {names[counts.index(min(counts))]} has {min(counts)} images, others have "
                f"{max(counts)}; give each camera one image per scene"
            )
        pairs, step = _pairs(rig, near), max(1, -(-counts[0] // MOST_SCENES))
        for scene, frames in enumerate(zip(*recorded.sources)):
            if scene % step:
                continue
            progress(scene / max(counts[0], 1), f"scene {scene}")
            stamps.append(min(frame.stamp_ns for frame in frames))
            greys = [cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY) for frame in frames]
            features = [features_of(grey, camera.intrinsics) for grey, camera in zip(greys, rig.cameras)]
            parts.append(_sightings(features, rig, pairs))
            pictures = pictures or {c: (0, grey) for c, grey in enumerate(greys)}
        notices = tuple(recorded.notices)
    if not parts:
        raise CalibrationError(f"{path}: cameras have no image of the same number; give one image per scene")
    images, none = (len(parts),) * len(names), (0,) * len(names)
    recording = BoardRecording(names, sizes, (), min(stamps), images, none, pictures, notices)
    return recording, _joined(parts)


def _pairs(rig: Rig, near: bool) -> list[tuple[int, int]]:
    """Return the pairs of cameras whose images are matched: all, or those that look most alike."""
    count = len(rig)
    if not near:
        return [(a, b) for b in range(count) for a in range(b)]
    axes = np.stack([camera.cam_from_world.rotation[2] for camera in rig.cameras])
    alike = axes @ axes.T
    np.fill_diagonal(alike, -np.inf)
    nearest = np.argsort(-alike, axis=1, kind="stable")[:, :NEIGHBOURS]
    return sorted({(min(a, int(b)), max(a, int(b))) for a in range(count) for b in nearest[a] if b != a})


def _sightings(
    features: Sequence[ImageFeatures], rig: Rig, pairs: Sequence[tuple[int, int]]
) -> PatternSightings:
    """Return the tracks of the features of one scene."""
    focals = [float(np.diag(camera.intrinsics.matrix)[:2].mean()) for camera in rig.cameras]
    matches = [matched(features[a], features[b], (a, b), 0.5 * (focals[a] + focals[b])) for a, b in pairs]
    counts = np.array([len(own.pixels) for own in features])
    tracks, cameras, numbers = tracks_of(counts, [own for own in matches if own is not None])
    pixels = np.array([features[c].pixels[n] for c, n in zip(cameras, numbers)]).reshape(-1, 2)
    return PatternSightings(cameras, tracks, pixels)


def _joined(scenes: Sequence[PatternSightings]) -> PatternSightings:
    """Return the points of all scenes, with numbers of their own."""
    ends = np.cumsum([0, *(int(own.points.max(initial=-1)) + 1 for own in scenes)])
    return PatternSightings(
        np.concatenate([own.cameras for own in scenes]),
        np.concatenate([own.points + end for own, end in zip(scenes, ends)]),
        np.concatenate([own.pixels for own in scenes]),
    )
