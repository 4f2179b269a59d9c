"""The public Python API of the package: `panoptic_ros` exports these functions."""

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
Parameters = Mapping[str, Mapping[str, Any]]  # {stage: {parameter: value}}, as `--set stage.parameter=value`


def load_rig(path: Path | str, cameras: Sequence[str] | None = None) -> Rig:
    """Read the calibrated cameras of a file, or of a folder that holds one.

    Args:
        cameras: use only these; None = all.

    Raises:
        UserError: if there is no calibration, or it cannot be used.
    """
    return read_rig_at(Path(path), cameras=cameras)


def open_detections(
    path: Path | str, rig: Rig, parameters: Parameters | None = None, *, skeleton: str = AUTO
) -> SolveTask:
    """Open the 2D people of a plain file, detections.json(.gz).

    Args:
        rig: the cameras that are used; the file may hold others.
        skeleton: name or YAML file; "auto" = that which fits the joints of the file best.

    Raises:
        UserError: if the file or a parameter cannot be used.
    """
    return solving.task_of(rig, Path(path), parameters or {}, skeleton)


def open_capture(
    path: Path | str, parameters: Parameters | None = None, *, cameras: Sequence[str] | None = None
) -> Plan:
    """Open a capture folder: a calibration, and one video or folder of images per camera.

    Args:
        cameras: use only these; None = all.

    Raises:
        UserError: if the folder or a parameter cannot be used.
    """
    return plan_capture(Path(path), RunOptions(parameters or {}), cameras=cameras)


def solve(recording: SolveTask | Plan) -> Sequence[TrackedPoseSet]:
    """Return the people of every instant of a recording, in the order of time, in m in the world of the rig.

    All stages run in this process, without ROS and without files; `run` leaves reports and pictures too.

    Args:
        recording: of `open_detections` or `open_capture`.

    Raises:
        UserError: if the images cannot be read or the model is missing.
    """
    if isinstance(recording, SolveTask):
        return solving.solve(recording).poses
    found = _Skeletons()
    run_in_process(recording, found, stop=lambda: False)
    return found


def write_skeletons(path: Path | str, recording: SolveTask | Plan, frames: Iterable[TrackedPoseSet]) -> None:
    """Write skeletons as skeletons.json(.gz); equal frames give equal bytes.

    Args:
        recording: from which they were solved, whose joints the file names.

    Raises:
        EnvironmentProblem: if the file cannot be written.
    """
    plain_formats.write_skeletons(Path(path), recording.joint_names, frames)


class _Skeletons(list[TrackedPoseSet]):
    """Keeps the result of a run."""

    def take(self, key: str, record: Any) -> None:
        """Keep a record of the topic `skeletons`."""
        if key == "skeletons":
            self.append(record)
