"""Reads rigs from files with all options, and checks them against 2D poses."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from panoptic_ros.domain import Rig
from panoptic_ros.errors import UsageError
from panoptic_ros.evaluation.rig_check import RigReport, check_rig
from panoptic_ros.evaluation.rig_frame import MarkedFloor, moved_rig, scaled_rig, world_on_floor
from panoptic_ros.evaluation.rig_up import direction_of, turned_up
from panoptic_ros.io.floor_points import read_floor_points
from panoptic_ros.io.plain_formats import read_detections
from panoptic_ros.io.rigs import find_rig, read_rig
from panoptic_ros.io.rigs.camera_info import POSES
from panoptic_ros.io.skeletons import load_skeleton, map_joints


def read_rig_at(
    path: Path,
    *,
    unit: str | None = None,
    types: Sequence[str] = (),
    panels: Sequence[int] = (),
    cameras: Sequence[str] | None = None,
) -> Rig:
    """Return the rig of a file, or of a folder that contains one (a capture folder, or the results of a run).

    Args:
        unit: m, cm or mm, for a TOML file that does not state its unit.
        types, panels: Selection of cameras in a CMU Panoptic file, see `io.rigs.read_rig`.
        cameras: Names of the cameras to use; None = all.

    Raises:
        UserError: if there is no rig, or it cannot be used.
    """
    if path.is_dir() and not (path / POSES).is_file():
        path = find_rig(path)
    return read_rig(path, unit=unit, types=types, panels=panels, cameras=cameras)


def check_views(rig: Rig, detections: Path | None = None) -> RigReport:
    """Check that the views of a rig agree, also by 2D poses if they are given.

    Args:
        detections: file with 2D poses, bag with detections, or results of a run.

    Raises:
        UserError: if the 2D poses cannot be read, or are of other cameras.
    """
    if detections is None:
        return check_rig(rig, (), load_skeleton("panoptic19"))
    from panoptic_ros.io.bags import bag_in  # imported here: `solve` needs no bags

    bag = bag_in(detections)
    if bag is not None:
        from panoptic_ros.running.runs.recorded_views import recorded_sets  # imported here: plans load slowly

        sets, skeleton = recorded_sets(bag, rig)
        return check_rig(rig, sets, skeleton)
    people = read_detections(detections)
    skeleton, mapping = map_joints("panoptic19", people.joint_names)
    return check_rig(rig, tuple(people.sets(rig, mapping, skeleton.hash)), skeleton)


def turned(rig: Rig, up: str) -> Rig:
    """Return the rig in a world frame with z up.

    Args:
        up: up direction in the rig's own world frame: x, -y, ..., or three numbers separated by commas.

    Raises:
        UsageError: if it is not a direction.
    """
    direction = direction_of(up)
    if direction is None:
        raise UsageError(f"--up {up!r} is not a direction; write an axis, as --up=-y, or three numbers")
    return turned_up(rig, direction)


def on_floor(rig: Rig, points: Path) -> Rig:
    """Return the rig in a world frame with z up and z = 0 on the floor.

    Args:
        points: CSV file of points on the floor, see `read_floor_points`.

    Raises:
        UserError: if the points do not determine a floor.
    """
    return moved_rig(rig, world_on_floor(rig, MarkedFloor(*read_floor_points(points, rig))))


def with_distance(rig: Rig, first: str, second: str, metres: float) -> tuple[Rig, float]:
    """Return the rig scaled so that two cameras are a measured distance, m, apart, and the factor.

    Raises:
        UserError: if a camera is not in the rig, or both have one place.
    """
    apart = float(np.linalg.norm(rig.camera(first).centre - rig.camera(second).centre))
    if not apart > 0.0:
        raise UsageError(f"cameras {first} and {second} have one place; their distance gives no scale")
    return scaled_rig(rig, metres / apart), metres / apart
