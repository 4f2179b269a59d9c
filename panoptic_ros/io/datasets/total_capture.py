"""A take of Total Capture (Trumble et al. 2017) as truth, samples of IMUs and the subject who wears them.

Their 21 joints and ours have the same spine of four; they have clavicles and no toes, we toes and no
clavicles. What either lacks is left out: toes of the truth are NaN. Their world has y up.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from panoptic_ros.domain.body_shape import offsets_of
from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.domain.subjects import BodyState, Device, ImuSeries, Subject
from panoptic_ros.errors import DataError
from panoptic_ros.geometry.rotations import from_quaternions, to_quaternions, vectors_of
from panoptic_ros.io.datasets.bone_axes import bone_axes
from panoptic_ros.io.datasets.total_capture_files import read_calibration, read_sensors, read_skeleton
from panoptic_ros.io.rigs.total_capture import Z_UP
from panoptic_ros.simulation.bodies.capture import DEVICES

Array = np.ndarray
RATE, INCH = 60.0, 0.0254
GRAVITY, TOLERANCE = np.array([0.0, 0.0, 9.81]), 2.0  # m/s^2, of the mean specific force of who moves
_SIDE = {
    "Arm": "UpperArm",
    "ForeArm": "Forearm",
    "Hand": "Hand",
    "UpLeg": "Thigh",
    "Leg": "Shin",
    "Foot": "Foot",
}
SEGMENTS = {  # ours by their joint
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
WORN = {  # segments by their sensor
    "Head": "head",
    "Sternum": "spine4",
    "Pelvis": "hips",
    **{f"{side}_{name}": f"{side.lower()}{ours}" for side in "LR" for name, ours in _LIMBS.items()},
}


def read_truth(positions: Path, orientations: Path, model: SegmentModel) -> tuple[list[BodyState], Array]:
    """True bodies at 60 Hz, from 0 ns on, and our axes of a segment from theirs (3, 3).

    Raises:
        DataError: naming the file and what is wrong.
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
    """Who moves: true lengths, and the IMUs with their mountings, in the usual places on their segments.

    Args:
        bone: `*_calib_imu_bone.txt`, bone from sensor. axes: our axes of a segment from theirs.
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
    """Samples of the IMUs at 60 Hz, from 0 ns on, whose inertial frame is the world's.

    Args:
        reference: `*_calib_imu_ref.txt`, world from the inertial frame of each.
        notices: a line goes into it if the accelerations are no specific forces, which are left out then.

    Raises:
        DataError: naming the file and what is wrong.
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
            f"{sensors}: accelerations of {', '.join(odd)} are no specific forces of {GRAVITY[2]:g} m/s^2 "
            "upwards on average; they are left out"
        )
    return devices


def degrees_off(
    subject: Subject, devices: Mapping[str, ImuSeries], truth: list[BodyState]
) -> dict[str, float]:
    """By how much each IMU with its mounting is off its true segment, deg, median over the frames that both
    have: whether calibration, samples and truth belong together."""
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
    """Samples and truth, of the frames that both have. Where one has more frames, they begin together or end
    together, whichever brings the IMUs nearer to the true segments; a line says which."""
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
    """Samples that are later by so many frames, as far as they lie in the count of frames."""
    found = {}
    for name, series in devices.items():
        numbers = np.arange(len(series.stamps)) + frames
        kept = (numbers >= 0) & (numbers < count)
        stamps = np.round(1e9 * numbers[kept] / RATE).astype(np.int64)
        found[name] = ImuSeries(stamps, series.quaternions[kept], series.rates[kept], series.forces[kept])
    return found
