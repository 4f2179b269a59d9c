"""Text files of Total Capture (Trumble et al. 2017): samples of IMUs, their calibration, and the skeleton.

`*_Xsens.sensors`: the numbers of sensors and frames; for every frame its number, counted from 1, and a line
of each sensor: name, quaternion w x y z, specific force in m/s^2, and in `*_Xsens_AuxFields.sensors` rate of
turn in rad/s and magnetic field, too. `*_calib_imu_bone.txt`, `*_calib_imu_ref.txt`: the number of sensors,
and a line of each: name, quaternion x y z w. `gt_skel_gbl_pos.txt`, `gt_skel_gbl_ori.txt`: names of the
joints, and a line of each frame: places in inches, quaternions x y z w.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from panoptic_ros.errors import DataError, shown
from panoptic_ros.io.loading import read_unpacked

Array = np.ndarray
COLUMNS = (7, 10, 13)  # quaternion and force; and rates; and magnetic field


class Sensors(NamedTuple):
    """Samples of N sensors: quaternions (N, T, 4) w x y z, forces and rates (N, T, 3); NaN = none."""

    names: tuple[str, ...]
    quaternions: Array
    forces: Array
    rates: Array


def read_sensors(path: Path) -> Sensors:
    """All samples of a `.sensors` file.

    Raises:
        DataError: naming the line and what is expected there.
    """
    lines = _lines(path)
    number, count = (int(value) for value in _numbers(path, 1, lines[0], 2, "numbers of sensors and frames"))
    if number < 1 or count < 1 or len(lines) < 1 + count * (number + 1):
        whole = 1 + max(count, 0) * (max(number, 0) + 1)
        raise DataError(f"{path}: {len(lines)} lines, expected {whole}: {count} frames of {number} sensors")
    names = tuple(line.split()[0] if line.split() else "" for line in lines[2 : 2 + number])
    width = len(lines[2].split()) - 1
    if width not in COLUMNS or len(set(names)) < number:
        told = ", ".join(map(str, COLUMNS))
        raise DataError(f"{path}, line 3: {width} numbers of {shown(names[0])}, expected a name and {told}")
    table = np.full((number, count, 10), np.nan)
    at = 1
    for frame in range(count):
        if lines[at].split() != [str(frame + 1)]:
            raise DataError(f"{path}, line {at + 1}: {shown(lines[at][:40])}, expected frame {frame + 1}")
        for k in range(number):
            at += 1
            name, *words = lines[at].split() or [""]
            if name != names[k]:
                raise DataError(f"{path}, line {at + 1}: sensor {shown(name)}, expected {shown(names[k])}")
            values = _numbers(path, at + 1, " ".join(words), width, f"those of {name}")
            table[k, frame, : min(width, 10)] = values[:10]
        at += 1
    return Sensors(names, table[..., :4], table[..., 4:7], table[..., 7:])


def read_calibration(path: Path) -> dict[str, Array]:
    """Quaternions w x y z of a calibration, by sensor.

    Raises:
        DataError: naming the line and what is expected there.
    """
    lines = _lines(path)
    number = int(_numbers(path, 1, lines[0], 1, "the number of sensors")[0])
    if number < 1 or len(lines) < 1 + number:
        raise DataError(f"{path}: {len(lines) - 1} sensors, expected {number}, as line 1 says")
    found = {}
    for k, line in enumerate(lines[1 : 1 + number]):
        name, *words = line.split() or [""]
        x, y, z, w = _numbers(path, k + 2, " ".join(words), 4, f"x y z w of {shown(name)}")
        if not 0.5 < w * w + x * x + y * y + z * z < 2.0:
            raise DataError(f"{path}, line {k + 2}: {shown(line.strip()[:60])} is no rotation")
        found[name] = np.array([w, x, y, z])
    return found


def read_skeleton(path: Path, width: int) -> tuple[tuple[str, ...], Array]:
    """Names of the joints and values (T, J, width) of every frame.

    Args:
        width: 3 of places, 4 of quaternions.

    Raises:
        DataError: naming the line and what is expected there.
    """
    lines = _lines(path)
    names = tuple(lines[0].split())
    count, rows = width * len(names), []
    for k, line in enumerate(lines[1:], start=2):
        rows.append(_numbers(path, k, line, count, f"{width} of each of {len(names)} joints"))
    if not names or not rows:
        raise DataError(f"{path} has no frames behind the names of its joints")
    return names, np.array(rows).reshape(len(rows), len(names), width)


def _lines(path: Path) -> list[str]:
    lines = read_unpacked(path).decode("utf-8", "replace").splitlines()
    while lines and not lines[-1].strip():
        lines.pop()
    if not lines:
        raise DataError(f"{path} is empty")
    return lines


def _numbers(path: Path, line: int, text: str, count: int, what: str) -> list[float]:
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        raise DataError(f"{path}, line {line}: {shown(text[:60])}, expected numbers: {what}") from None
    if len(values) != count or not np.isfinite(values).all():
        raise DataError(f"{path}, line {line}: {len(values)} numbers, expected {count}: {what}")
    return values
