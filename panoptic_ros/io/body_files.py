"""Read and write solved bodies in `kinematics.json.gz`, as a whole or frame by frame.

docs/bodies.md lists every key.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.domain import BodyStateSet
from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.domain.subjects import BodyState
from panoptic_ros.errors import DataError
from panoptic_ros.geometry.rotations import from_quaternions, to_quaternions
from panoptic_ros.io.files import known, write_json
from panoptic_ros.io.frame_stream import FrameStream, read_frames
from panoptic_ros.io.known_keys import keys, tell_unknown
from panoptic_ros.io.loading import parsing

Array = np.ndarray
KINEMATICS = "panoptic-kinematics-1"
_SUBJECT = keys(
    "id positions orientations joint_angles velocities angular_velocities position_covariances "
    "orientation_covariances"
)
KEYS = keys("format segment_names joint_names", frames=[keys("index stamp_ns", subjects=[_SUBJECT])])


def write_bodies(path: Path, model: SegmentModel, states: Iterable[BodyState]) -> None:
    """Write solved bodies as `panoptic-kinematics-1`; equal states give equal bytes."""
    frames: dict[int, list[dict[str, Any]]] = {}
    for state in states:
        frames.setdefault(state.stamp_ns, []).append(body_row(model, state))
    rows = [
        {"index": k, "stamp_ns": stamp, "subjects": sorted(frames[stamp], key=lambda row: int(row["id"]))}
        for k, stamp in enumerate(sorted(frames))
    ]
    names = {"segment_names": list(model.names), "joint_names": list(model.joint_names)}
    write_json(path, {"format": KINEMATICS, **names, "frames": rows})


def body_row(model: SegmentModel, state: BodyState) -> dict[str, Any]:
    """Return one body as a row of the file.

    Positions are in m and joint angles in rad. Orientations are quaternions. Velocities (m/s) and angular
    velocities (rad/s) are added if the state has them.
    """
    row = {
        "id": state.id,
        "positions": known(np.round(state.places, 5).tolist()),
        "orientations": known(np.round(to_quaternions(state.frames), 6).tolist()),
        "joint_angles": known(np.round(model.joint_angles(state.frames), 5).tolist()),
    }
    if state.velocities is not None and state.spins is not None:
        row["velocities"] = np.round(state.velocities, 4).tolist()
        row["angular_velocities"] = np.round(state.spins, 4).tolist()
    if state.covariances is not None:
        row["position_covariances"] = _triangles(state.covariances[:, :3, :3])
        row["orientation_covariances"] = _triangles(state.covariances[:, 3:, 3:])
    return row


def _triangles(matrices: Array) -> list[list[float]]:
    """Return the upper triangles (6 values each) of symmetric matrices (N, 3, 3), to four digits."""
    rows, columns = np.triu_indices(3)
    return [[float(f"{value:.3e}") for value in row] for row in matrices[:, rows, columns]]


def _matrices(triangles: Any) -> Array:
    values = np.array(triangles, float)
    found: Array = values[:, [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
    return found


def read_bodies(path: Path) -> tuple[tuple[str, ...], list[BodyState]]:
    """Read the segment names and the bodies of a `panoptic-kinematics-1` file, in the order of the file.

    Raises:
        DataError: naming the file and the fault.
    """
    document = read_frames(path)
    if not isinstance(document, dict) or document.get("format") != KINEMATICS:
        raise DataError(f"{path} is not a {KINEMATICS} file")
    tell_unknown(document, KEYS, path)
    with parsing(path):
        states = [
            _body_state(int(frame["stamp_ns"]), row)
            for frame in document["frames"]
            for row in frame["subjects"]
        ]
        return tuple(map(str, document["segment_names"])), states


def _body_state(stamp_ns: int, row: Mapping[str, Any]) -> BodyState:
    """Return the body of a row; the covariance blocks between position and rotation are zero.

    The file holds only the position covariance and the orientation covariance of each segment.
    """
    velocities, spins, covariances = (
        None if key not in row else np.array(row[key], float)
        for key in ("velocities", "angular_velocities", "position_covariances")
    )
    if covariances is not None:
        both = np.zeros((len(covariances), 6, 6))
        both[:, :3, :3] = _matrices(covariances)
        both[:, 3:, 3:] = _matrices(row["orientation_covariances"])
        covariances = both
    return BodyState(
        stamp_ns,
        int(row["id"]),
        np.array(row["positions"], float),
        from_quaternions(np.array(row["orientations"], float)),
        velocities,
        spins,
        covariances,
    )


class BodyStream(FrameStream):
    """Writer of bodies frame by frame, in the format of `write_bodies`. Frames without a body are skipped.

    Args:
        model: segment skeleton of all bodies.

    Raises:
        EnvironmentProblem: if the file cannot be written.
    """

    def __init__(self, path: Path, model: SegmentModel):
        self._model = model
        names = {"segment_names": list(model.names), "joint_names": list(model.joint_names)}
        super().__init__(path, {"format": KINEMATICS, **names})

    def take(self, item: BodyStateSet) -> None:
        """Write one frame."""
        rows = [body_row(self._model, state) for state in states_of(item)]
        if rows:
            index = self.count
            self.add({"index": index, "stamp_ns": item.stamp_ns, "subjects": rows})


def states_of(item: BodyStateSet) -> list[BodyState]:
    """Return the bodies of a set as single states; a covariance that is not finite becomes None."""
    found = []
    for k, number in enumerate(item.ids.tolist()):
        known = bool(np.isfinite(item.covariances[k]).all())
        found.append(
            BodyState(
                item.stamp_ns,
                number,
                item.positions[k],
                from_quaternions(item.orientations[k]),
                item.velocities[k, :, :3],
                item.velocities[k, :, 3:],
                item.covariances[k] if known else None,
            )
        )
    return found
