"""Calibrate cameras with known intrinsics from recorded 2D poses of walking people."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from panoptic_ros.calibration.lens_start import LensModel
from panoptic_ros.calibration.people.frame import scale_of, scaled, world_of
from panoptic_ros.calibration.people.lens_check import check_focals, focal_faults
from panoptic_ros.calibration.people.quality import (
    PeopleQuality,
    doubts_of_people,
    predicted_line,
    quality_of_people,
    refusals_of_people,
)
from panoptic_ros.calibration.people.solve import CalibratedPeople, calibrate_people
from panoptic_ros.calibration.projection import FISHEYE_TERMS, LENS, POSE
from panoptic_ros.calibration.rig_start import CameraInput
from panoptic_ros.calibration.world import rig_in_world
from panoptic_ros.domain import Camera, Rig, SkeletonModel, ViewDetections
from panoptic_ros.errors import CalibrationError, DataError, UsageError, UserError
from panoptic_ros.io.bags import bag_in
from panoptic_ros.io.clock_files import write_offsets
from panoptic_ros.io.files import write_bytes
from panoptic_ros.io.rigs import find_rig, write_rig
from panoptic_ros.io.rigs.intrinsics import read_intrinsics
from panoptic_ros.running.calibration.results import CLOCKS, PAGE, RIG
from panoptic_ros.running.continuous import read_continuous_task
from panoptic_ros.running.grouping import views_in_order
from panoptic_ros.stage import Progress
from panoptic_ros.view.people_report import people_page

Array = np.ndarray
SKELETON = "panoptic19"  # skeleton whose body joints are used; joints of other detectors are mapped to it


@dataclass(frozen=True, eq=False)
class PeopleCalibration:
    """Calibration from people.

    Args:
        rig: Cameras in the world.
        solved: Solution in the frame of the first camera, in m.
        quality: Its quality.
        start_ns: First stamp.
        doubts: Lines about limits that are exceeded. notices: Lines about the recording and the world frame.
    """

    rig: Rig
    solved: CalibratedPeople
    quality: PeopleQuality
    start_ns: int
    doubts: tuple[str, ...]
    notices: tuple[str, ...]

    @property
    def predicted(self) -> str:
        """Return the line about the predicted errors."""
        return predicted_line(self.quality)


def calibrate_recorded_people(
    source: Path,
    intrinsics: Path | None,
    progress: Progress,
    *,
    stature_m: float | None = None,
    distance: tuple[str, str, float] | None = None,
    synchronous: bool = False,
) -> PeopleCalibration:
    """Return the calibration of the cameras of a recording.

    Args:
        source: Capture folder, results of a run, bag, or a file of 2D poses.
        intrinsics: Rig with the intrinsics; None = that of the recording. Its poses are not used.
        stature_m: Mean stature, m, of the people.
        distance: Names of two cameras and their measured distance, m.
        synchronous: The cameras are synchronous; clock offsets are not estimated.

    Raises:
        UserError: if the recording does not give a calibration.
    """
    known, views, skeleton, told = read_views(source, intrinsics, progress)
    found = calibrate_views(known, views, skeleton, progress, stature_m, distance, synchronous)
    return replace(found, notices=(*told, *found.notices))


def read_views(
    source: Path, intrinsics: Path | None, progress: Progress
) -> tuple[Rig, list[ViewDetections], SkeletonModel, tuple[str, ...]]:
    """Return the cameras with known intrinsics, all 2D poses, their skeleton, and notices."""
    if intrinsics is None and bag_in(source) is None:
        try:
            intrinsics = find_rig(source)
        except UserError:
            raise UsageError(
                f"{source} has no intrinsics of its cameras; give them with --intrinsics RIG"
            ) from None
    given = None if intrinsics is None else read_intrinsics(intrinsics)
    if source.is_file() and bag_in(source) is None:
        task = read_continuous_task(given, source, skeleton=SKELETON)
    else:
        task = read_continuous_task(given, None, skeleton=SKELETON, capture=source, progress=progress)
    views = views_in_order(task.recording.records("detection_sets"))
    if not any(len(view.points) for view in views):
        raise DataError(f"{source}: none of the {len(views)} views shows a person; record people who walk")
    return task.context.rig, views, task.context.skeleton, task.notices


def calibrate_views(
    known: Rig,
    views: Sequence[ViewDetections],
    skeleton: SkeletonModel,
    progress: Progress,
    stature_m: float | None = None,
    distance: tuple[str, str, float] | None = None,
    synchronous: bool = False,
) -> PeopleCalibration:
    """Return the calibration from 2D poses; for the arguments see `calibrate_recorded_people`."""
    if len(known) < 2:
        raise CalibrationError(
            f"people calibrate two cameras or more; there is one, {known.names[0]}: record with more cameras"
        )
    tape = None
    if distance is not None:
        tape = (known.index(distance[0]), known.index(distance[1]), distance[2])
    inputs = [_input(camera) for camera in known.cameras]
    solved = calibrate_people(inputs, views, skeleton, progress, clocks=not synchronous)
    scale = scale_of(solved, stature_m, tape)
    solved = scaled(solved, scale.factor)
    quality = quality_of_people(solved, scale)
    if reasons := refusals_of_people(quality):
        raise CalibrationError(f"the people do not determine the cameras: {'; '.join(reasons)}")
    wrong, doubtful = focal_faults(check_focals(solved), known.names)
    if wrong:
        raise CalibrationError(f"the given intrinsics are wrong: {'; '.join(wrong)}")
    notices = []
    if tape is None and stature_m is None:
        notices.append(
            f"the scale is that of adults of mean stature, ± {scale.sd:.0%}; give --stature M, or a measured "
            "distance with --distance CAM_A,CAM_B=M"
        )
    rig = _with_known(rig_in_world(solved.rig, world_of(solved)), known)
    start_ns = min(view.stamp_ns for view in views)
    doubts = (*doubts_of_people(quality), *doubtful)
    return PeopleCalibration(rig, solved, quality, start_ns, doubts, tuple(notices))


def _input(camera: Camera) -> CameraInput:
    """Return a camera with its known lens."""
    matrix, terms = camera.intrinsics.matrix, camera.intrinsics.distortion
    if len(terms) > LENS - 4 or matrix[0, 1] != 0.0:
        raise CalibrationError(
            f"camera {camera.name}: given intrinsics have {len(terms)} terms or a skew; give some with at "
            f"most {LENS - 4} terms and no skew"
        )
    lens = np.zeros(LENS)
    lens[:4] = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
    lens[4 : 4 + len(terms)] = terms
    fisheye = camera.intrinsics.lens == "fisheye"
    model = LensModel(fisheye, FISHEYE_TERMS if fisheye else LENS - 4)
    return CameraInput(camera.name, camera.image_size, model, (lens, np.zeros((LENS, LENS))))


def _with_known(rig: Rig, known: Rig) -> Rig:
    """Return the rig with lenses, clocks and line delays of the known cameras."""
    cameras = []
    for found, camera in zip(rig.cameras, known.cameras):
        covariance = found.covariance
        if covariance is not None and camera.covariance is not None:
            poses, covariance = covariance[:POSE, :POSE], camera.covariance.copy()
            covariance[:POSE, POSE:] = covariance[POSE:, :POSE] = 0.0
            covariance[:POSE, :POSE] = poses
        cameras.append(replace(camera, cam_from_world=found.cam_from_world, covariance=covariance))
    return Rig(tuple(cameras))


def write_people_calibration(folder: Path, found: PeopleCalibration) -> list[str]:
    """Write rig.json, clocks.json if offsets were estimated, and report.html; return their names."""
    folder.mkdir(parents=True, exist_ok=True)
    page = people_page(
        found.quality.rig,
        found.predicted,
        found.solved.rig.links,
        (*found.doubts, *found.notices),
    )
    write_bytes(folder / PAGE, page.encode())
    offsets = {
        camera.name: (camera.offset_s, camera.offset_sd_s, c == 0 or camera.offset_sd_s > 0.0)
        for c, camera in enumerate(found.quality.rig.cameras)
    }
    estimated = any(deviation > 0.0 for _, deviation, _ in offsets.values())
    if estimated:
        write_offsets(folder / CLOCKS, offsets, found.start_ns)
    write_rig(folder / RIG, found.rig)
    return [RIG, *([CLOCKS] if estimated else []), PAGE]
