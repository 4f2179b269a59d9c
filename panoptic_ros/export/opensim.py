"""Write bodies for OpenSim: joint centres as markers (TRC), and joint angles as a motion (MOT)."""

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
    """Return the TRC file of one person's joint centres: mm, y up, x forward, z right.

    A marker has the name of the segment that begins at the joint.

    Args:
        states: bodies of one person in order of time.
        name: file name, which the file states.

    Raises:
        DataError: if there are fewer than two frames.
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
    """Return the MOT file of one person's joint angles and root motion.

    Joint angles are in degrees, named as in REP 155 (`l_y_shoulder`). The root has its position in m, and
    roll, pitch and yaw of its successive rotations about z, y, x. Its axes are those of a world with z up.

    Args:
        states: bodies of one person in order of time.
        name: name of the motion.

    Raises:
        DataError: if there are fewer than two frames.
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
