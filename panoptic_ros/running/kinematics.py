"""Estimates bodies from files of 2D poses and IMU samples, without ROS."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from panoptic_ros.domain import Rig
from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.domain.subjects import ImuSeries, Subject, ViewPeople, ViewSeries
from panoptic_ros.errors import CalibrationError, UsageError
from panoptic_ros.evaluation.rig_up import assumed_up
from panoptic_ros.io.body_context import body_extras
from panoptic_ros.io.detector_context import noise_only
from panoptic_ros.io.kinematic_files import read_imus
from panoptic_ros.io.plain_formats import PlainDetections, read_detections
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.pose.prior import PoseStatistics
from panoptic_ros.kinematics.session import BodyRecording, BodySolution, solve_recording
from panoptic_ros.params import load
from panoptic_ros.running.plans.rig_files import read_rig_at

Array = np.ndarray
PAPER = "malleson-2020"
PRESETS: dict[str, dict[str, object]] = {  # section 3.2.6 of the paper: each frame is solved independently
    PAPER: {
        "window": False,
        "paper_weights": True,
        "noise_level": False,
        "mounting": False,
        "paper_sorting": True,
        "iterations": 20,
    },
}


@dataclass(frozen=True, eq=False)
class BodyTask:
    """Input of the body solver, with lines about irregularities in the files."""

    config: KinematicsConfig
    recording: BodyRecording
    subjects: tuple[Subject, ...]
    statistics: PoseStatistics
    notices: tuple[str, ...] = ()

    @property
    def model(self) -> SegmentModel:
        """Return the segment model that all subjects share."""
        return self.subjects[0].body.model


def read_body_task(
    subjects: Sequence[Path],
    config: KinematicsConfig,
    rig: Path | None,
    detections: Path | None,
    imu: Path | None,
    prior: str = "",
) -> BodyTask:
    """Read the input of the body solver from files.

    Args:
        subjects: subject files.
        rig: calibration file or folder. It needs `detections`.
        detections: plain file of 2D poses. It needs `rig`.
        imu: file of IMU samples. Cameras, IMUs or both must be given.
        prior: file of the pose prior; "" = the one of the configuration.

    Raises:
        UserError: on any input fault that the user can fix.
    """
    if (rig is None) != (detections is None):
        raise UsageError("--rig and --detections belong together: give both, or neither for IMUs alone")
    if rig is None and imu is None:
        raise UsageError("there is nothing to solve from: give --rig and --detections, or --imu, or both")
    known = body_extras(subjects, config.segments, prior or config.prior, config.offsets)
    people: tuple[Subject, ...] = known["subjects"]
    notices: list[str] = []
    devices = _worn_devices(imu, people, notices) if imu is not None else {}
    views: dict[int, ViewSeries] = {}
    used: Rig | None = None
    names: tuple[str, ...] = ()
    if rig is not None and detections is not None:
        used, found = read_rig_at(rig), read_detections(detections)
        notices += used.notices
        views, names = view_series(used, found), found.joint_names
    notices += [line for subject in people for line in subject.told()]
    notices += [*used.notices, *assumed_up(used), *noise_only(())] if used is not None else []
    for subject in people:
        odd = sorted(subject.body.own - {*subject.body.model.keypoints, *names})
        if odd:
            text = f"no detector has its keypoints {', '.join(odd)}; check their names"
            notices.append(f"subject {subject.id}: {text}")
    recording = BodyRecording(used, names, views, devices)
    return BodyTask(config, recording, people, known["pose_prior"], tuple(notices))


def _worn_devices(imu: Path, people: Sequence[Subject], notices: list[str]) -> dict[str, ImuSeries]:
    """Return the IMU samples of a file.

    Args:
        notices: receives lines about devices that no subject wears, and about worn devices without samples.
    """
    devices = read_imus(imu, notices)
    worn = [device.name for subject in people for device in subject.devices]
    missing = [name for name in worn if name not in devices]
    if missing and len(missing) == len(worn):
        raise UsageError(f"{imu} has no samples of {', '.join(missing)}, which a subject wears")
    if missing:
        notices.append(f"{imu} has no samples of {', '.join(missing)}; bodies are solved without them")
    unworn = [name for name in devices if name not in worn]
    if unworn:
        notices.append(f"{imu}: no subject wears {', '.join(unworn)}; they are left out")
    return devices


def solve_bodies(task: BodyTask) -> BodySolution:
    """Solve a recording for the bodies of its subjects."""
    solved = solve_recording(task.recording, task.subjects, task.config, task.statistics)
    return replace(solved, notices=[*task.notices, *solved.notices])


def body_config(
    preset: str = "", settings: Sequence[str] = (), *, lag: float | None = None, rate_hz: float | None = None
) -> KinematicsConfig:
    """Return a kinematics configuration.

    Later values override earlier ones: the preset, then the settings, then lag and rate.

    Args:
        preset: name in `PRESETS`; "" = none.
        settings: texts of the form NAME=VALUE.
        lag: parameter `lag`, s; None = not overridden.
        rate_hz: parameter `rate_hz`, Hz; None = not overridden.

    Raises:
        UserError: if there is no such preset or parameter, or a value is out of range.
    """
    values: dict[str, object] = {}
    if preset:
        if preset not in PRESETS:
            raise UsageError(f"there is no preset {preset!r} for kinematics; there is {', '.join(PRESETS)}")
        values |= PRESETS[preset]
    for setting in settings:
        name, equals, text = setting.partition("=")
        if not equals:
            raise UsageError(f"--set {setting!r} is not NAME=VALUE")
        values[name.removeprefix("kinematics.")] = _value(text)
    values |= {} if lag is None else {"lag": lag}
    values |= {} if rate_hz is None else {"rate_hz": rate_hz}
    return load(KinematicsConfig, values, "kinematics.")


def _value(text: str) -> object:
    try:
        return json.loads(text)
    except ValueError:
        return text


def view_series(rig: Rig, people: PlainDetections) -> dict[int, ViewSeries]:
    """Return the 2D poses of every camera by time, in normalised image coordinates (plane at distance 1).

    Raises:
        CalibrationError: if the rig lacks the camera of a view.
    """
    index = {name: k for k, name in enumerate(rig.names)}
    rows: dict[int, dict[int, ViewPeople]] = {}
    for frame in people.frames:
        for name, view in frame.views.items():
            if name in rig.left_out:
                continue
            if name not in index:
                raise CalibrationError(
                    f"the detections have a camera {name!r} that the rig lacks; it has {', '.join(rig.names)}"
                )
            camera = rig.cameras[index[name]]
            plane = np.full(view.points.shape, np.nan)
            there = np.isfinite(view.points).all(-1)
            if there.any():
                plane[there] = camera.intrinsics.undistort(view.points[there])
            stamp = view.stamp_ns + round(1e9 * camera.middle_s)
            rows.setdefault(index[name], {})[stamp] = ViewPeople(plane, view.scores)
    return {
        camera: ViewSeries(np.array(sorted(found)), tuple(found[stamp] for stamp in sorted(found)))
        for camera, found in rows.items()
    }
