"""Read a take of Total Capture (Trumble et al. 2017): true bodies, IMU samples and the subject.

Its 21 joints and our segments share a spine of four parts. It has clavicles and no toes; our skeleton has
toes and no clavicles. Parts that one side lacks are left out, so toes of the truth are NaN. Its world frame
has y up. `bone_axes` finds the axis convention of its bone frames from the joint positions in them.

Text files:

`*_Xsens.sensors`: the numbers of sensors and frames. Then for every frame its number, counted from 1, and a
line for each sensor: name, quaternion w x y z, specific force in m/s^2. `*_Xsens_AuxFields.sensors` adds
angular rate in rad/s and magnetic field.

`*_calib_imu_bone.txt`, `*_calib_imu_ref.txt`: the number of sensors, and a line for each: name, quaternion x
y z w.

`gt_skel_gbl_pos.txt`, `gt_skel_gbl_ori.txt`: joint names, and a line for each frame: positions in inches,
quaternions x y z w.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import permutations, product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain.body_shape import offsets_of
from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.domain.subjects import BodyState, Device, ImuSeries, Subject
from panoptic_ros.errors import DataError, shown
from panoptic_ros.geometry.rotations import from_quaternions, to_quaternions, vectors_of
from panoptic_ros.io.loading import read_unpacked
from panoptic_ros.io.rigs.total_capture import Z_UP
from panoptic_ros.simulation.bodies.capture import DEVICES

Array = np.ndarray
RATE, INCH = 60.0, 0.0254
# m/s^2; largest deviation of a moving person's mean specific force from GRAVITY
GRAVITY, TOLERANCE = np.array([0.0, 0.0, 9.81]), 2.0
_SIDE = {
    "Arm": "UpperArm",
    "ForeArm": "Forearm",
    "Hand": "Hand",
    "UpLeg": "Thigh",
    "Leg": "Shin",
    "Foot": "Foot",
}
SEGMENTS = {  # our segment by their joint
    "Hips": "hips",
    "Spine": "spine1",
    "Spine1": "spine2",
    "Spine2": "spine3",
    "Spine3": "spine4",
    "Neck": "neck",
    "Head": "head",
    **{f"Left{theirs}": f"l{ours}" for theirs, ours in _SIDE.items()},
    **{f"Right{theirs}": f"r{ours}" for theirs, ours in _SIDE.items()},
}
_LIMBS = {"UpArm": "UpperArm", "LowArm": "Forearm", "UpLeg": "Thigh", "LowLeg": "Shin", "Foot": "Foot"}
WORN = {  # segment by sensor
    "Head": "head",
    "Sternum": "spine4",
    "Pelvis": "hips",
    **{f"{side}_{name}": f"{side.lower()}{ours}" for side in "LR" for name, ours in _LIMBS.items()},
}


def read_truth(positions: Path, orientations: Path, model: SegmentModel) -> tuple[list[BodyState], Array]:
    """Read the true bodies at 60 Hz, from 0 ns, and the rotation (3, 3) to our bone axes from the file's.

    Raises:
        DataError: naming the file and the fault.
    """
    names, inches = read_skeleton(positions, 3)
    others, turns = read_skeleton(orientations, 4)
    if names != others:
        raise DataError(f"{orientations} has other joints than {positions}: {', '.join(others[:5])}, ...")
    lacking = [name for name in SEGMENTS if name not in names]
    if lacking:
        raise DataError(f"{positions} has no joint {', '.join(lacking)}; it has {', '.join(names)}")
    if len(turns) != len(inches):
        raise DataError(f"{orientations} has {len(turns)} frames, {positions} {len(inches)}")
    theirs = [names.index(name) for name in SEGMENTS]
    ours = [model.index(name) for name in SEGMENTS.values()]
    places = np.full((len(inches), len(model.names), 3), np.nan)
    frames = np.full((*places.shape, 3), np.nan)
    places[:, ours] = INCH * inches[:, theirs] @ Z_UP.T
    frames[:, ours] = Z_UP @ from_quaternions(turns[:, theirs][..., [3, 0, 1, 2]])
    try:
        axes = bone_axes(model, places, frames)
    except DataError as error:
        raise DataError(f"{orientations}: {error}") from None
    frames = frames @ axes.T
    states = [BodyState(round(1e9 * t / RATE), 0, places[t], frames[t]) for t in range(len(places))]
    return states, axes


def read_subject(bone: Path, truth: list[BodyState], axes: Array, model: SegmentModel) -> Subject:
    """Read the subject: true segment lengths, and the IMUs with mounting rotations at default positions.

    Args:
        bone: `*_calib_imu_bone.txt` with rotations from sensor axes to bone axes of the data set.
        axes: rotation (3, 3) from bone axes of the data set to ours.

    Raises:
        DataError: if the file has no sensor that is worn.
    """
    places, frames = (np.array([getattr(s, name) for s in truth]) for name in ("places", "frames"))
    offsets = offsets_of(model, places, frames)
    lengths, shares = (np.linalg.norm(rows, axis=-1) for rows in (offsets, model.shares))
    known = np.isfinite(lengths) & (model.parents >= 0)
    stature = float(lengths[known].sum() / shares[known].sum())
    lacking = ~np.isfinite(lengths)
    offsets[lacking] = stature * model.shares[lacking]
    body, usual = model.body(stature).with_offsets(dict(zip(model.names, offsets))), dict(DEVICES)
    devices = tuple(
        Device(name, model.index(WORN[name]), np.array(usual[WORN[name]]), axes @ from_quaternions(turn))
        for name, turn in read_calibration(bone).items()
        if name in WORN
    )
    if not devices:
        raise DataError(f"{bone} has none of the sensors {', '.join(WORN)}")
    return Subject(0, body, devices, start=places[0, 0].round(3), stature=stature)


def read_imus(sensors: Path, reference: Path, notices: list[str]) -> dict[str, ImuSeries]:
    """Read the IMU samples at 60 Hz, starting at 0 ns, with orientations in the world frame.

    Args:
        reference: `*_calib_imu_ref.txt`, rotation world from the inertial frame of each sensor.
        notices: receives a line if accelerations are not specific forces. They are then left out.

    Raises:
        DataError: naming the file and the fault.
    """
    found, world = read_sensors(sensors), read_calibration(reference)
    lacking = [name for name in found.names if name in WORN and name not in world]
    if lacking:
        raise DataError(f"{reference} has no sensor {', '.join(lacking)}")
    devices, odd = {}, []
    stamps = np.round(1e9 * np.arange(found.quaternions.shape[1]) / RATE).astype(np.int64)
    for k, name in enumerate(found.names):
        if name not in WORN:
            continue
        turns = Z_UP @ from_quaternions(world[name]) @ from_quaternions(found.quaternions[k])
        forces = found.forces[k]
        mean = (turns @ forces[..., None])[..., 0].mean(0)
        if np.linalg.norm(mean - GRAVITY) > TOLERANCE:
            odd.append(name)
            forces = np.full_like(forces, np.nan)
        devices[name] = ImuSeries(stamps, to_quaternions(turns), found.rates[k], forces)
    if not devices:
        raise DataError(f"{sensors} has none of the sensors {', '.join(WORN)}")
    if odd:
        notices.append(
            f"{sensors}: accelerations of {', '.join(odd)} are not specific forces of {GRAVITY[2]:g} m/s^2 "
            "upwards on average; they are left out"
        )
    return devices


def degrees_off(
    subject: Subject, devices: Mapping[str, ImuSeries], truth: list[BodyState]
) -> dict[str, float]:
    """Return the angle (deg) between each mounted IMU and its true segment, median over common frames.

    A large angle shows that calibration, samples and truth come from different recordings.
    """
    at, found = {state.stamp_ns: state for state in truth}, {}
    for device in subject.devices:
        if device.name not in devices or device.mount is None:
            continue
        series = devices[device.name]
        both = [k for k, stamp in enumerate(series.stamps.tolist()) if stamp in at]
        turns = from_quaternions(series.quaternions[both]) @ device.mount.T
        frames = np.array([at[int(series.stamps[k])].frames[device.segment] for k in both])
        between = np.ascontiguousarray(turns.swapaxes(-1, -2) @ frames)
        found[device.name] = float(np.median(np.degrees(np.linalg.norm(vectors_of(between), axis=-1))))
    return found


def placed_in_time(
    subject: Subject, devices: Mapping[str, ImuSeries], truth: list[BodyState], notices: list[str]
) -> tuple[dict[str, ImuSeries], list[BodyState]]:
    """Return the samples and the truth of their common frames.

    If one has more frames, they are aligned at the beginning or at the end. The alignment with the smaller
    angle between IMUs and true segments is used, and a notice reports it.
    """
    samples = min(len(series.stamps) for series in devices.values())
    more = len(truth) - samples
    if not more:
        return dict(devices), truth
    ways = {word: _moved(devices, later, len(truth)) for word, later in (("begin", 0), ("end", more))}
    degrees = {word: list(degrees_off(subject, way, truth).values()) for word, way in ways.items()}
    off = {word: float(np.median(values)) for word, values in degrees.items()}
    best, other = sorted(off, key=lambda word: off[word])
    notices.append(
        f"{samples} frames of IMUs and {len(truth)} of the truth {best} together: {off[best]:.1f} deg off "
        f"true segments ({off[other]:.1f} if they {other} together)"
    )
    there = set.intersection(*(set(series.stamps.tolist()) for series in ways[best].values()))
    return ways[best], [state for state in truth if state.stamp_ns in there]


def _moved(devices: Mapping[str, ImuSeries], frames: int, count: int) -> dict[str, ImuSeries]:
    """Return the samples shifted later by `frames`, limited to the frames 0 to `count` - 1."""
    found = {}
    for name, series in devices.items():
        numbers = np.arange(len(series.stamps)) + frames
        kept = (numbers >= 0) & (numbers < count)
        stamps = np.round(1e9 * numbers[kept] / RATE).astype(np.int64)
        found[name] = ImuSeries(stamps, series.quaternions[kept], series.rates[kept], series.forces[kept])
    return found


FARTHEST = 30.0  # deg, limit of the mean angle between joint directions in their bones and in ours


def bone_axes(model: SegmentModel, places: Array, frames: Array) -> Array:
    """Return the rotation (3, 3) to our bone axes from the other skeleton's; all bones share one rotation.

    In a T-pose all bones of a skeleton have equal axes. The function tests the 24 axis-aligned rotations. It
    returns the one with the smallest mean angle between the child joint directions in their bones and in
    ours.

    Args:
        places: (T, S, 3) m, in the order of our segments; NaN = missing in the other skeleton.
        frames: (T, S, 3, 3), rotation world from bone, in the same order.

    Raises:
        DataError: if no rotation brings the joint directions within FARTHEST.
    """
    found, wanted = [], []
    for s, parent in enumerate(model.parents):
        if parent < 0:
            continue
        arms = (frames[:, parent].swapaxes(-1, -2) @ (places[:, s] - places[:, parent])[..., None])[..., 0]
        arms = arms[np.isfinite(arms).all(-1)]
        if len(arms):
            arm = np.median(arms, axis=0)
            found.append(arm / max(float(np.linalg.norm(arm)), 1e-9))
            wanted.append(model.shares[s] / np.linalg.norm(model.shares[s]))
    ways = [
        np.array([sign * np.eye(3)[axis] for sign, axis in zip(signs, axes)])
        for axes in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]
    turns = [way for way in ways if np.linalg.det(way) > 0.0]
    if not found:
        raise DataError("no two joints of a bone are there at the same time")
    angles = [float(np.mean(_degrees(np.array(found) @ turn.T, np.array(wanted)))) for turn in turns]
    best = int(np.argmin(angles))
    if angles[best] > FARTHEST:
        raise DataError(
            f"joints lie {angles[best]:.0f} deg off where bones of our skeleton have them; are orientations "
            "those of the bones, from the bone to the world?"
        )
    return turns[best]


def _degrees(a: Array, b: Array) -> Array:
    found: Array = np.degrees(np.arccos(np.clip((a * b).sum(-1), -1.0, 1.0)))
    return found


COLUMNS = (7, 10, 13)  # numbers of a line: quaternion and force; with rates; with magnetic field


class ImuSignals(NamedTuple):
    """Samples of N sensors: quaternions (N, T, 4) w x y z, forces and rates (N, T, 3); NaN = missing."""

    names: tuple[str, ...]
    quaternions: Array
    forces: Array
    rates: Array


def read_sensors(path: Path) -> ImuSignals:
    """Read all samples of a `.sensors` file.

    Raises:
        DataError: naming the line and the expected content.
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
    return ImuSignals(names, table[..., :4], table[..., 4:7], table[..., 7:])


def read_calibration(path: Path) -> dict[str, Array]:
    """Read the quaternions w x y z of a calibration file, by sensor.

    Raises:
        DataError: naming the line and the expected content.
    """
    lines = _lines(path)
    number = int(_numbers(path, 1, lines[0], 1, "the number of sensors")[0])
    if number < 1 or len(lines) < 1 + number:
        raise DataError(f"{path}: {len(lines) - 1} sensors, expected {number} according to line 1")
    found = {}
    for k, line in enumerate(lines[1 : 1 + number]):
        name, *words = line.split() or [""]
        x, y, z, w = _numbers(path, k + 2, " ".join(words), 4, f"x y z w of {shown(name)}")
        if not 0.5 < w * w + x * x + y * y + z * z < 2.0:
            raise DataError(f"{path}, line {k + 2}: {shown(line.strip()[:60])} is not a rotation")
        found[name] = np.array([w, x, y, z])
    return found


def read_skeleton(path: Path, width: int) -> tuple[tuple[str, ...], Array]:
    """Read the joint names and the values (T, J, width) of all frames.

    Args:
        width: 3 for positions, 4 for quaternions.

    Raises:
        DataError: naming the line and the expected content.
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
