"""Bodies for OpenSim: joint centres as markers (TRC), and joint angles as a motion (MOT)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.domain.subjects import BodyState
from panoptic_ros.export.resampled import motion_of
from panoptic_ros.geometry.euler import euler_angles

Array = np.ndarray
FILE_FROM_WORLD = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # x forward, y up, z right
ROOT = ("tx", "ty", "tz", "roll", "pitch", "yaw")


def trc_text(model: SegmentModel, states: Sequence[BodyState], name: str) -> str:
    """Joint centres of one person, named by the segments that begin there: mm, y up, x forward, z right.

    Args:
        states: of one person, by time. name: of the file, which stands in it.

    Raises:
        DataError: if there are fewer than two instants.
    """
    motion = motion_of(model, states, "TRC")
    rate, count, markers = 1.0 / motion.period, len(motion.places), len(model.names)
    points = 1e3 * motion.places @ FILE_FROM_WORLD.T
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{rate:.6f}\t{rate:.6f}\t{count}\t{markers}\tmm\t{rate:.6f}\t1\t{count}",
        "Frame#\tTime\t" + "\t".join(f"{segment}\t\t" for segment in model.names).rstrip("\t"),
        "\t\t" + "\t".join(f"X{k}\tY{k}\tZ{k}" for k in range(1, markers + 1)),
        "",
    ]
    for k, row in enumerate(points.reshape(count, -1)):
        lines.append(f"{k + 1}\t{k * motion.period:.6f}\t" + "\t".join(f"{value:.3f}" for value in row))
    return "\n".join(lines) + "\n"


def mot_text(model: SegmentModel, states: Sequence[BodyState], name: str) -> str:
    """Joint angles of one person by time, degrees, named as in REP 155 (`l_y_shoulder`), and the root's: its
    place, m, and its roll, pitch and yaw as it turns about z, y, x one after another, in the axes of a world
    with z up.

    Args:
        states: of one person, by time. name: of the motion.

    Raises:
        DataError: if there are fewer than two instants.
    """
    motion = motion_of(model, states, "MOT")
    count = len(motion.places)
    turns = np.degrees(euler_angles(motion.frames[:, 0], "zyx"))[:, ::-1]
    angles = np.degrees(model.joint_angles(motion.frames))
    times = motion.period * np.arange(count)
    table = np.concatenate([times[:, None], motion.places[:, 0], turns, angles], axis=1)
    columns = ["time", *(f"root_{word}" for word in ROOT), *model.joint_names]
    head = [name, "version=1", f"nRows={count}", f"nColumns={len(columns)}", "inDegrees=yes", "endheader"]
    rows = ["\t".join(f"{value:.6f}" for value in row) for row in table]
    return "\n".join([*head, "\t".join(columns), *rows]) + "\n"
