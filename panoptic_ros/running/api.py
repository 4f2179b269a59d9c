"""Public Python API of the package; `panoptic_ros` exports these functions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from panoptic_ros.domain import Rig, TrackedPoseSet
from panoptic_ros.io import plain_formats
from panoptic_ros.io.recorded_people import AUTO
from panoptic_ros.running import solve as solving
from panoptic_ros.running.plans.options import RunOptions
from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.running.plans.planning import plan_capture
from panoptic_ros.running.plans.rig_files import read_rig_at
from panoptic_ros.running.runs.in_process import run_in_process
from panoptic_ros.running.runs.run import run
from panoptic_ros.running.solve import SolveTask

__all__ = ["load_rig", "open_capture", "open_detections", "run", "solve", "write_skeletons"]
# {stage: {parameter: value}}, as in `--set stage.parameter=value`
Parameters = Mapping[str, Mapping[str, Any]]


def load_rig(path: Path | str, cameras: Sequence[str] | None = None) -> Rig:
    """Read the calibrated cameras of a file, or of a folder that contains a calibration file.

    Args:
        path: calibration file or folder.
        cameras: names of the cameras to use; None = all.

    Raises:
        UserError: if there is no calibration, or it cannot be used.
    """
    return read_rig_at(Path(path), cameras=cameras)


def open_detections(
    path: Path | str, rig: Rig, parameters: Parameters | None = None, *, skeleton: str = AUTO
) -> SolveTask:
    """Open the 2D poses of a plain file, detections.json(.gz).

    Args:
        rig: the cameras to use. The file may contain other cameras as well.
        skeleton: name or YAML file of a skeleton; "auto" = the one that fits the joints of the file best.

    Raises:
        UserError: if the file or a parameter cannot be used.
    """
    return solving.task_of(rig, Path(path), parameters or {}, skeleton)


def open_capture(
    path: Path | str, parameters: Parameters | None = None, *, cameras: Sequence[str] | None = None
) -> Plan:
    """Open a capture folder: a calibration, and one video or folder of images per camera.

    Args:
        cameras: names of the cameras to use; None = all.

    Raises:
        UserError: if the folder or a parameter cannot be used.
    """
    return plan_capture(Path(path), RunOptions(parameters or {}), cameras=cameras)


def solve(recording: SolveTask | Plan) -> Sequence[TrackedPoseSet]:
    """Return the 3D poses of every instant of a recording, in time order, m, in the world frame of the rig.

    All stages run in this process, without ROS and without files. Use `run` to get reports and pictures as
    well.

    Args:
        recording: the result of `open_detections` or `open_capture`.

    Raises:
        UserError: if the images cannot be read or the pose model is missing.
    """
    if isinstance(recording, SolveTask):
        return solving.solve(recording).poses
    found = _Skeletons()
    run_in_process(recording, found, stop=lambda: False)
    return found


def write_skeletons(path: Path | str, recording: SolveTask | Plan, frames: Iterable[TrackedPoseSet]) -> None:
    """Write 3D poses to a file, skeletons.json(.gz). Equal frames give equal bytes.

    Args:
        recording: the recording that the frames were solved from. It provides the joint names of the file.

    Raises:
        EnvironmentProblem: if the file cannot be written.
    """
    plain_formats.write_skeletons(Path(path), recording.joint_names, frames)


class _Skeletons(list[TrackedPoseSet]):
    """List of the 3D poses of a run."""

    def take(self, key: str, record: Any) -> None:
        """Append a record of the topic `skeletons`; ignore all other topics."""
        if key == "skeletons":
            self.append(record)
