"""Calibrate the cameras of a recording with a board, and write the rig, its clocks and the report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from panoptic_ros.calibration.boards import Board
from panoptic_ros.calibration.lens_start import LensModel
from panoptic_ros.calibration.projection import LENS, POSE
from panoptic_ros.calibration.quality import Quality, doubts, quality_of, refusals
from panoptic_ros.calibration.rig_start import CameraInput
from panoptic_ros.calibration.solve import CalibratedRig, calibrate_from, calibrate_rig
from panoptic_ros.calibration.stretch import jackknife_sd, stretch_of
from panoptic_ros.calibration.tape import TAPE_SD_M, distance_of
from panoptic_ros.calibration.wand_start import start_wand
from panoptic_ros.calibration.wands import Wand, parse_wand
from panoptic_ros.calibration.world import floor_from_images, floor_from_target, rig_in_world
from panoptic_ros.domain import Camera, Rig
from panoptic_ros.domain.camera import POSE_AND_MATRIX
from panoptic_ros.errors import CalibrationError, UsageError
from panoptic_ros.running.calibration.depth_sensors import NO_SENSORS, check_sensors, with_depth_sensors
from panoptic_ros.running.calibration.recorded_board import BoardRecording, read_board_views
from panoptic_ros.running.calibration.recorded_wand import read_wand_views
from panoptic_ros.stage import Progress

Array = np.ndarray
# standard deviations of given intrinsics whose file states no covariance: relative, px, without unit
KNOWN_FOCAL, KNOWN_CENTRE_PX, KNOWN_TERM = 0.01, 5.0, 0.05
CERTAIN = 3.0  # standard deviations of a stretch of the print that is certain
GOOD_SIZE = 0.02  # relative difference of the target's size to that by a tape, which users mistake by 1 %
GOOD_STRETCH, REFUSED_STRETCH = 2e-3, 5e-3  # relative; 1 % triples errors, 0.3 % adds a third
MODELS = {
    "brown": LensModel(),
    "rational": LensModel(terms=8),
    "fisheye": LensModel(fisheye=True, terms=4),
}


@dataclass(frozen=True, eq=False)
class BoardCalibration:
    """Calibration from a board.

    Args:
        rig: Cameras in the world.
        solved: Solution in the frame of the first camera.
        quality: Its quality.
        doubts: Lines about limits that are exceeded.
        notices: Lines about the recording and the world frame.
    """

    rig: Rig
    board: Board | Wand | None
    recording: BoardRecording
    solved: CalibratedRig
    quality: Quality
    doubts: tuple[str, ...]
    notices: tuple[str, ...]


def calibrate_recording(
    path: Path,
    board: Board,
    progress: Progress,
    *,
    lens: str = "brown",
    known: Rig | None = None,
    floor_s: float | None = None,
    synchronous: bool = False,
    distance: tuple[str, str, float] | None = None,
    sensors: Mapping[str, str] = NO_SENSORS,
) -> BoardCalibration:
    """Return the calibration of the cameras of a folder or bag.

    Args:
        lens: A name of `MODELS`, for cameras whose intrinsics are not known.
        known: Cameras with known intrinsics.
        floor_s: Time, s since the first image, at which the board lies on the floor; None = never.
        synchronous: The cameras are synchronous; clock offsets are not estimated.
        distance: Names of two cameras and their measured distance, m, which checks the size of the board.
        sensors: Colour camera by the name of the camera that shows the infrared images of a depth sensor.

    Raises:
        UserError: if the recording does not give a calibration.
    """
    recording = read_board_views(path, board, progress)
    check_all_see(recording, "board")
    check_names(distance, recording.names)
    check_sensors(recording.names, sensors)
    inputs = [
        input_of(name, size, MODELS[lens], known) for name, size in zip(recording.names, recording.sizes)
    ]
    _check_mirrors(recording)
    solved = calibrate_rig(inputs, recording.views, board.points, clocks=not synchronous, turns=board.turns)
    quality = quality_of(solved)
    if reasons := refusals(quality):
        raise CalibrationError(f"the recording does not determine the cameras: {'; '.join(reasons)}")
    stretch, sd = stretch_of(solved)
    stretched = abs(stretch) > max(GOOD_STRETCH, CERTAIN * sd)
    stretched = stretched and abs(stretch) > CERTAIN * jackknife_sd(solved)
    if stretched and abs(stretch) > REFUSED_STRETCH:
        raise CalibrationError(
            f"{_stretched(stretch)}; print it again at 100 %, without fitting it to the page"
        )
    notices = list(recording.notices)
    if stretched:
        notices.append(f"{_stretched(stretch)}; measure both sides, and print it again at 100 %")
    notices += wrong_sizes(solved, distance, "its squares")
    if floor_s is None:
        world = floor_from_images(solved)
        notices.append(
            "up is the mean of the images' up directions and z = 0 is the lowest point of the board; for a "
            "real floor, lay the board on it and give the time with --floor SECONDS, or mark its points for "
            "`panoptic rig convert --floor-points`"
        )
    else:
        world = floor_from_target(solved, _nearest_target(solved, floor_s))
    rig, told = with_depth_sensors(rig_in_world(solved, world), solved, recording.depths, sensors)
    notices += told
    return BoardCalibration(
        rig,
        board,
        recording,
        solved,
        quality,
        tuple(doubts(quality)),
        tuple(notices),
    )


def calibrate_with_wand(
    path: Path,
    text: str,
    progress: Progress,
    known: Rig | None,
    synchronous: bool = False,
    distance: tuple[str, str, float] | None = None,
) -> BoardCalibration:
    """Return the calibration of the cameras of a folder or bag from a wand.

    Args:
        text: Specification of the wand, see `parse_wand`.
        known: Cameras with known intrinsics, which are refined.
        synchronous: The cameras are synchronous; clock offsets are not estimated.
        distance: Names of two cameras and their measured distance, m, which checks the size of the wand.

    Raises:
        UserError: if the recording does not give a calibration.
    """
    wand = parse_wand(text)
    recording = read_wand_views(path, wand, progress)
    check_all_see(recording, "wand")
    check_names(distance, recording.names)
    inputs = [
        input_of(name, size, LensModel(), known) for name, size in zip(recording.names, recording.sizes)
    ]
    start = start_wand(inputs, recording.views, wand.points)
    solved = calibrate_from(start, inputs, wand.points, clocks=not synchronous)
    notices = wrong_sizes(solved, distance, "its lengths")
    return without_floor("wand", wand, recording, solved, quality_of(solved), notices)


def without_floor(
    kind: str,
    target: Board | Wand | None,
    recording: BoardRecording,
    solved: CalibratedRig,
    quality: Quality,
    notices: Sequence[str] = (),
) -> BoardCalibration:
    """Return the calibration from a target that never lies on the floor; the images give the vertical.

    Args:
        kind: Name of the target for messages.

    Raises:
        CalibrationError: if the cameras are too uncertain.
    """
    if reasons := refusals(quality, kind):
        raise CalibrationError(f"the recording does not determine the cameras: {'; '.join(reasons)}")
    up = (
        f"up is the mean of the images' up directions and z = 0 is the lowest place of the {kind}; mark "
        "points on the floor for `panoptic rig convert --floor-points`"
    )
    rig, told = rig_in_world(solved, floor_from_images(solved)), (*recording.notices, *notices, up)
    return BoardCalibration(rig, target, recording, solved, quality, tuple(doubts(quality, kind)), told)


def check_names(distance: tuple[str, str, float] | None, names: Sequence[str]) -> None:
    """Refuse a measured distance of cameras that the recording does not have.

    Raises:
        UsageError: naming the camera.
    """
    for name in distance[:2] if distance is not None else ():
        if name not in names:
            raise UsageError(f"--distance: there is no camera {name!r}; cameras are {', '.join(names)}")


def wrong_sizes(solved: CalibratedRig, distance: tuple[str, str, float] | None, target: str) -> list[str]:
    """Return a line if a measured distance of two cameras contradicts the size of the target."""
    if distance is None:
        return []
    names = [camera.name for camera in solved.inputs]
    apart, sd = distance_of(solved, names.index(distance[0]), names.index(distance[1]))
    factor = distance[2] / max(apart, 1e-9)
    allowed = max(GOOD_SIZE, CERTAIN * float(np.hypot(sd, TAPE_SD_M)) / distance[2])
    if abs(factor - 1.0) <= allowed:
        return []
    return [
        f"cameras {distance[0]} and {distance[1]} are {apart:.3f} m apart by the target, but "
        f"{distance[2]:g} m by the tape: {target} are probably {factor:.3f} times as large as given; "
        "measure them and correct --board"
    ]


def check_all_see(recording: BoardRecording, target: str) -> None:
    """Refuse recordings in which a camera never sees the target.

    Raises:
        CalibrationError: naming these cameras.
    """
    seen = {view.camera for view in recording.views}
    blind = [name for c, name in enumerate(recording.names) if c not in seen]
    if blind:
        names, more = ", ".join(blind), len(blind) > 1
        raise CalibrationError(
            f"camera{'s' * more} {names}: no image shows the {target}; show it, or move the files of the "
            f"camera{'s' * more} away"
        )


def _check_mirrors(recording: BoardRecording) -> None:
    """Refuse cameras that mirror their images; the back of a two-sided board shows in some cameras only.

    Raises:
        CalibrationError: if no view shows the board unmirrored.
    """
    if sum(recording.mirrored) == len(recording.views):
        raise CalibrationError(
            "all images show the board mirrored; switch mirroring off in the cameras' drivers, or print the "
            "board unmirrored"
        )


def _stretched(stretch: float) -> str:
    longer = "wide" if stretch > 0.0 else "high"
    return f"the print of the board is {abs(stretch):.2%} too {longer}"


def input_of(name: str, size: tuple[int, int], model: LensModel, known: Rig | None) -> CameraInput:
    """Return a camera with what is known of its lens.

    Raises:
        CalibrationError: if the known lens is for images of another size.
    """
    if known is None or name not in known.names:
        return CameraInput(name, size, model)
    camera = known.camera(name)
    if camera.image_size != size:
        raise CalibrationError(
            f"camera {name}: images are {size[0]} x {size[1]}, its given intrinsics are for "
            f"{camera.image_size[0]} x {camera.image_size[1]}; give intrinsics for this size"
        )
    return CameraInput(name, size, _model_of(camera), _prior_of(camera))


def _model_of(camera: Camera) -> LensModel:
    terms = len(camera.intrinsics.distortion)
    if camera.intrinsics.lens == "fisheye":
        return MODELS["fisheye"]
    if terms > 8 or camera.intrinsics.matrix[0, 1] != 0.0:
        raise CalibrationError(
            f"camera {camera.name}: given intrinsics have {terms} terms or a skew; at most 8 terms are "
            "calibrated"
        )
    return MODELS["rational" if terms > 5 else "brown"]


def _prior_of(camera: Camera) -> tuple[Array, Array]:
    """Return the lens (12,) and information (12, 12) of a camera with known intrinsics."""
    matrix, terms = camera.intrinsics.matrix, camera.intrinsics.distortion
    lens = np.zeros(LENS)
    lens[:4] = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
    lens[4 : 4 + len(terms)] = terms
    count = 4 + len(terms)
    if camera.covariance is not None:
        own = camera.covariance[POSE : POSE_AND_MATRIX + len(terms), POSE : POSE_AND_MATRIX + len(terms)]
        variances = np.diag(own)
    else:
        variances = np.zeros(count)
    if not (variances > 0.0).all():
        sd = np.concatenate([[KNOWN_FOCAL * lens[0]] * 2, [KNOWN_CENTRE_PX] * 2, [KNOWN_TERM] * len(terms)])
        own = np.diag(sd**2)
    information = np.zeros((LENS, LENS))
    information[:count, :count] = np.linalg.inv(own)
    return lens, information


def _nearest_target(solved: CalibratedRig, floor_s: float) -> int:
    stamps = np.full(len(solved.state.targets.rotations), np.inf)
    for view in solved.views:
        stamps[view.instant] = min(stamps[view.instant], view.stamp_s)
    nearest = int(np.argmin(np.abs(stamps - floor_s)))
    if abs(stamps[nearest] - floor_s) > 1.0:
        raise UsageError(
            f"--floor {floor_s:g}: the board is not seen within 1 s of it; the nearest view is at "
            f"{stamps[nearest]:.2f} s"
        )
    return nearest
