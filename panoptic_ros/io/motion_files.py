"""Read recorded joint motion from BVH files and arrays of clips (.npz), in metres with z up."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.errors import DataError, one_line, plain, shown
from panoptic_ros.io.arrays import arrays_of
from panoptic_ros.io.documents import read_yaml
from panoptic_ros.io.loading import parsing, read_unpacked
from panoptic_ros.io.resources import share_folder
from panoptic_ros.kinematics.body.fitting import Site

Array = np.ndarray
# Smallest length of a prefix shared by all joint names that is removed, such as "mixamorig" and "bip01".
SHORTEST_PREFIX = 4
UPPER_ARMS = ("leftarm", "rightarm", "upperarm", "uparm")  # name endings of upper arms, without underscores
ROTATIONS = ("Xrotation", "Yrotation", "Zrotation")


class JointTrajectories(NamedTuple):
    """Joint positions (T, J, 3) of one person, with joint names and frame rate (Hz)."""

    name: str
    joint_names: tuple[str, ...]
    joints: Array
    rate: float


def read_clip_arrays(path: Path) -> list[JointTrajectories]:
    """Read the clips of an .npz: `clips` (names), `joint_names`, `fps`, and `clip_<name>` (T, J, 3) m, z up.

    Raises:
        DataError: if one of these arrays is missing or has a wrong shape.
    """
    with arrays_of(path) as found:
        try:
            names = tuple(str(name) for name in found["joint_names"])
            return [
                _checked(str(clip), names, found[f"clip_{clip}"].astype(float), float(found["fps"]), path)
                for clip in found["clips"]
            ]
        except KeyError as error:
            raise DataError(f"{path} has no clips of joints: {one_line(error)}") from None


def read_bvh(path: Path, unit: float) -> JointTrajectories:
    """Read the joints of a BVH file; y is up in the file, as usual.

    Args:
        unit: length unit of the file, m.

    Raises:
        DataError: naming the file and the fault.
    """
    words = iter(read_unpacked(path).decode("utf-8", "replace").split())
    with parsing(path):
        return _bvh(words, path, unit)


def _checked(
    name: str, joint_names: tuple[str, ...], joints: Array, rate: float, path: Path
) -> JointTrajectories:
    """Return the motion after checking its shape and rate.

    Raises:
        DataError: if `joints` is not (T, J, 3), or the rate is not positive and finite.
    """
    if joints.ndim != 3 or joints.shape[1:] != (len(joint_names), 3):
        shape = " x ".join(map(str, joints.shape))
        raise DataError(f"{path}: clip {shown(name)} is {shape}, expected frames x {len(joint_names)} x 3")
    if not 0.0 < rate < math.inf:
        raise DataError(f"{path}: fps is {rate:g}, expected a rate in Hz")
    return JointTrajectories(name, joint_names, joints, rate)


def _bvh(words: Iterator[str], path: Path, unit: float) -> JointTrajectories:
    try:
        names, parents, offsets, channels = _hierarchy(words)
        _expect(words, "MOTION", "Frames:")
        count = int(next(words))
        _expect(words, "Frame", "Time:")
        period = float(next(words))
        values = np.array([float(word) for word in words])
        table = values.reshape(count, sum(len(own) for own in channels))
    except (StopIteration, ValueError, IndexError) as error:
        raise DataError(f"{path} is not an intact BVH file: {one_line(error)}") from None
    if not 0.0 < period < math.inf or not np.isfinite(table).all() or not np.isfinite(offsets).all():
        raise DataError(f"{path}: frames of {period} s or numbers that are none")
    places = _placed(parents, np.array(offsets), channels, table)
    upright = np.stack([places[..., 2], places[..., 0], places[..., 1]], axis=-1)
    return JointTrajectories(path.stem, tuple(names), unit * upright, 1.0 / period)


def read_sites(model: SegmentModel) -> dict[str, Site]:
    """Return the positions of recorded joints on the segment skeleton, by joint name (see `named`).

    Joints on segments that the skeleton lacks are left out.
    """
    table: dict[str, Any] = dict(read_yaml(share_folder() / "config" / "bodies" / "motion_joints.yaml"))
    found: dict[str, Site] = {}
    for rows in (table.pop("ends"), table):
        for segment, row in rows.items():
            if segment not in model.names:
                continue
            share = np.array(row.get("offset", (0.0, 0.0, 0.0)), float)
            found |= {named(name): Site(model.index(segment), share) for name in row["names"]}
    return found


def named(name: str) -> str:
    """Normalise a joint name: lower case, without blanks and without a prefix that ends in a colon."""
    return name.rpartition(":")[2].lower().replace(" ", "")


def _hierarchy(words: Iterator[str]) -> tuple[list[str], list[int], list[list[float]], list[list[str]]]:
    names: list[str] = []
    parents: list[int] = []
    offsets: list[list[float]] = []
    channels: list[list[str]] = []
    above: list[int] = []
    _expect(words, "HIERARCHY")
    for word in words:
        if word in ("ROOT", "JOINT", "End"):
            name = next(words)
            names.append(f"{names[above[-1]]} end" if word == "End" else name)
            parents.append(above[-1] if above else -1)
            offsets.append([0.0, 0.0, 0.0])
            channels.append([])
        elif word == "{":
            above.append(len(names) - 1)
        elif word == "OFFSET":
            offsets[above[-1]] = [float(next(words)) for _ in range(3)]
        elif word == "CHANNELS":
            channels[above[-1]] = [next(words) for _ in range(int(next(words)))]
        elif word == "}":
            above.pop()
            if not above:
                break
        else:
            raise ValueError(word)
    return names, parents, offsets, channels


def _expect(words: Iterator[str], *wanted: str) -> None:
    for want in wanted:
        word = next(words)
        if word != want:
            raise ValueError(f"{word} instead of {want}")


def _placed(parents: list[int], offsets: Array, channels: list[list[str]], table: Array) -> Array:
    """Return joint positions (T, J, 3) in the axes and unit of the file, by forward kinematics."""
    count = len(table)
    places, frames = np.zeros((count, len(parents), 3)), np.zeros((count, len(parents), 3, 3))
    column = 0
    for k, parent in enumerate(parents):
        local, turned = np.tile(offsets[k], (count, 1)), np.tile(np.eye(3), (count, 1, 1))
        for channel in channels[k]:
            if channel in ROTATIONS:
                turned = turned @ _about(ROTATIONS.index(channel), np.radians(table[:, column]))
            else:
                local[:, "XYZ".index(channel[0])] = table[:, column]
            column += 1
        if parent < 0:
            places[:, k], frames[:, k] = local, turned
        else:
            places[:, k] = places[:, parent] + (frames[:, parent] @ local[..., None])[..., 0]
            frames[:, k] = frames[:, parent] @ turned
    return places


def _about(axis: int, angles: Array) -> Array:
    """Return rotations (T, 3, 3) by `angles` (T,) rad about a coordinate axis."""
    found = np.zeros((len(angles), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    found[:, axis, axis] = 1.0
    found[:, i, i] = found[:, j, j] = np.cos(angles)
    found[:, j, i] = np.sin(angles)
    found[:, i, j] = -np.sin(angles)
    return found


def named_plainly(motion: JointTrajectories, sites: Mapping[str, Site]) -> JointTrajectories:
    """Rename the joints of a motion to the names of the sites; drop joints without a site.

    The prefix that all names share is removed. Names are compared exactly first, then without underscores and
    hyphens. If several joints match one site, the exact match is kept. LeftShoulder means the shoulder if
    there is no LeftArm; left_hand means the wrist if there is no other joint for it.
    """
    names = [named(name) for name in motion.joint_names]
    common = _shared_beginning([name for name in names if not name.endswith("end")])
    names = [name[common:].lstrip("_-") for name in names]
    arms = any(plain(name).endswith(UPPER_ARMS) for name in names)
    begins = {name: site for name, site in sites.items() if not np.any(site.share)}
    # (joint index, name) by position on the skeleton
    taken: dict[tuple[int, tuple[float, ...]], tuple[int, str]] = {}
    for table, exactly in ((begins, True), (begins, False), (sites, True), (sites, False)):
        known = {name if exactly else plain(name): name for name in table}
        for k, name in enumerate(names):
            found = known.get(name if exactly else plain(name))
            if arms and name.endswith("shoulder"):
                continue  # the name means a clavicle if the upper arm has its own name
            if found is not None and all(k != joint for joint, _ in taken.values()):
                place = table[found].segment, tuple(table[found].share.tolist())
                taken.setdefault(place, (k, found))
    kept = sorted(taken.values())
    return motion._replace(
        joint_names=tuple(name for _, name in kept), joints=motion.joints[:, [k for k, _ in kept]]
    )


def _shared_beginning(names: Sequence[str]) -> int:
    """Return the length of the prefix that all names share; 0 if shorter than SHORTEST_PREFIX."""
    same = 0
    for letters in zip(*names):
        if len(names) < 2 or len(set(letters)) > 1:
            break
        same += 1
    return same if same >= SHORTEST_PREFIX else 0
