"""Read and write the plain formats of 2D and 3D poses: `detections.json.gz` and `skeletons.json.gz`.

Both are JSON, gzipped if the name ends in .gz, in metres, pixels and integer nanoseconds. A missing joint is
null. docs/files.md defines every key. `SkeletonStream` writes frame by frame, so memory does not grow with
the duration of a run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.domain import DetectionSet, JointMap, JointState, Rig, TrackedPoseSet, ViewDetections
from panoptic_ros.errors import CalibrationError, DataError, UserError, shown
from panoptic_ros.io.documents import read_json
from panoptic_ros.io.files import atomic_path, write_json
from panoptic_ros.io.frame_stream import FrameStream, read_frames
from panoptic_ros.io.known_keys import EACH, keys, tell_unknown
from panoptic_ros.io.loading import parsing

Array = np.ndarray
DETECTIONS = "panoptic-detections-1"
SKELETONS = "panoptic-skeletons-1"
DETECTION_KEYS = keys(
    "format joint_names", frames=[keys("index stamp_ns", views={EACH: keys("stamp_ns persons")})]
)
_PERSON = keys("id joints scores covariances views states ignore")
SKELETON_KEYS = keys("format joint_names", frames=[keys("index stamp_ns", skeletons=[_PERSON])])
# Limit of scores in a file. OpenPose and SimCC networks give slightly more than 1, which is clipped to 1.
HIGHEST_SCORE = 1.25
_UPPER = np.triu_indices(3)
FRAME = "a frame of OpenPose"
FOREIGN = {  # keys that identify other programs' formats, in the document or in the first entry of a list
    FRAME: {"version", "people"},
    "a result of AlphaPose or of COCO": {"image_id", "keypoints"},
    "a result of MMPose": {"meta_info", "instance_info"},
    "a result of MMPose of each frame": {"frame_id", "instances"},
    "annotations of COCO": {"images", "annotations"},
}
REMEDY = (
    f"write it as {DETECTIONS}, with stamps and the names of cameras: docs/files.md has a program for that"
)


@dataclass(frozen=True, slots=True, eq=False)
class PlainView:
    """2D poses of one view: points (P, K, 2) px, NaN = missing; scores (P, K), 0 = missing."""

    stamp_ns: int
    points: Array
    scores: Array


@dataclass(frozen=True, slots=True, eq=False)
class PlainFrame:
    """Views of one frame, by camera name."""

    index: int
    stamp_ns: int
    views: Mapping[str, PlainView]


@dataclass(frozen=True, slots=True, eq=False)
class PlainDetections:
    """A whole file of 2D poses, in the detector's own K joints."""

    joint_names: tuple[str, ...]
    frames: tuple[PlainFrame, ...]

    def sets(
        self,
        rig: Rig,
        joint_map: JointMap,
        skeleton_hash: str,
        known: Iterable[str] = (),
        any_order: bool = False,
    ) -> Iterator[DetectionSet]:
        """Yield detection sets in the working skeleton, for the cameras of the rig.

        Args:
            known: names of further cameras that may occur, in addition to `rig` and `rig.left_out`.
            any_order: accept timestamps that decrease.

        Raises:
            CalibrationError: if a view's camera is neither in the rig nor in `known`.
            DataError: if timestamps decrease.
        """
        allowed = {*rig.names, *rig.left_out, *known}
        last = -1
        for frame in self.frames:
            if frame.stamp_ns < last and not any_order:
                raise DataError(f"frame {frame.index}: stamp {frame.stamp_ns} is before the previous one")
            last = frame.stamp_ns
            for name in frame.views:
                if name not in allowed:
                    raise CalibrationError(
                        f"the detections have a camera {shown(name)} that the rig lacks; it has "
                        f"{', '.join(rig.names)}"
                    )
            views = []
            for camera in rig.cameras:
                view = frame.views.get(camera.name)
                if view is not None:
                    points, scores = joint_map.apply(view.points, view.scores)
                    views.append(
                        ViewDetections(
                            camera.name,
                            view.stamp_ns,
                            frame.index,
                            camera.image_size,
                            skeleton_hash,
                            points,
                            scores,
                            _person_scores(scores),
                        )
                    )
            yield DetectionSet(frame.index, frame.stamp_ns, skeleton_hash, tuple(views))


@dataclass(frozen=True, slots=True, eq=False)
class PlainSkeletonFrame:
    """3D poses of one frame, with P people and J joints.

    Args:
        ids: (P,).
        positions: (P, J, 3) m.
        scores: (P, J).
        covariances: (P, J, 3, 3) m^2.
        ignore: (P,).
        views: (P, J), number of views that measured a joint; 0 = predicted or filled, -1 = not stated.
    """

    index: int
    stamp_ns: int
    ids: Array
    positions: Array
    scores: Array
    covariances: Array
    ignore: Array
    views: Array


@dataclass(frozen=True, slots=True, eq=False)
class PlainSkeletons:
    """A whole file of 3D poses, results or truth."""

    joint_names: tuple[str, ...]
    frames: tuple[PlainSkeletonFrame, ...]


def read_detections(path: Path) -> PlainDetections:
    """Read 2D poses.

    Raises:
        DataError: naming the file, the frame and the fault.
    """
    document, names = _document(path, DETECTIONS)
    tell_unknown(document, DETECTION_KEYS, path)
    frames = []
    for number, frame in enumerate(document["frames"]):
        where = f"{path}, frame {number}"
        with parsing(where):
            views = {
                str(name): PlainView(
                    _integer(view["stamp_ns"], where),
                    *_joint_rows(view["persons"], len(names), 3, f"{where}, camera {name}"),
                )
                for name, view in frame["views"].items()
            }
            frames.append(PlainFrame(_index(frame, number, where), _integer(frame["stamp_ns"], where), views))
    return PlainDetections(names, tuple(frames))


def write_detections(path: Path, joint_names: Iterable[str], sets: Iterable[DetectionSet]) -> None:
    """Write 2D poses; the joints of the sets must be `joint_names`."""
    frames = []
    for item in sets:
        views = {}
        for view in item.views:
            rows = np.concatenate([view.points, view.scores[..., None]], axis=-1)
            persons = [[_row(joint) for joint in person] for person in rows]
            views[view.camera] = {"stamp_ns": view.stamp_ns, "persons": persons}
        frames.append({"index": item.index, "stamp_ns": item.stamp_ns, "views": views})
    write_json(path, {"format": DETECTIONS, "joint_names": list(joint_names), "frames": frames})


def read_skeletons(path: Path) -> PlainSkeletons:
    """Read 3D poses, results or truth; if the file ends early, its complete frames, with a warning.

    Raises:
        DataError: naming the file, the frame and the fault.
    """
    document, names = _document(path, SKELETONS, read_frames)
    tell_unknown(document, SKELETON_KEYS, path)
    frames = []
    for number, frame in enumerate(document["frames"]):
        where = f"{path}, frame {number}"
        with parsing(where):
            people = frame["skeletons"]
            positions, _ = _joint_rows([p["joints"] for p in people], len(names), 3, where, scored=False)
            there = np.isfinite(positions).all(-1)
            scores = np.array([p.get("scores") or t for p, t in zip(people, there.astype(float))], float)
            unknown = [-1] * len(names)
            views = np.array([p.get("views") or unknown for p in people], np.int64)
            covariances = np.full((*positions.shape, 3), np.nan)
            for k, person in enumerate(people):
                for j, upper in enumerate(person.get("covariances") or []):
                    if upper is not None:
                        covariances[k, j][_UPPER] = upper
                        covariances[k, j].T[_UPPER] = upper
            frames.append(
                PlainSkeletonFrame(
                    _index(frame, number, where),
                    _integer(frame["stamp_ns"], where),
                    np.array([int(p["id"]) for p in people], np.int64),
                    positions,
                    scores.reshape(positions.shape[:2]),
                    covariances,
                    np.array([bool(p.get("ignore", False)) for p in people], bool),
                    views.reshape(positions.shape[:2]),
                )
            )
    return PlainSkeletons(names, tuple(frames))


def write_skeletons(path: Path, joint_names: Iterable[str], sets: Iterable[TrackedPoseSet]) -> None:
    """Write 3D poses frame by frame, all or nothing; equal sets give equal bytes."""
    path = Path(path)
    with atomic_path(path) as temporary:
        stream = SkeletonStream(temporary, joint_names, path.name.endswith(".gz"), path)
        try:
            for item in sets:
                stream.take(item)
            stream.close()
        except BaseException:
            stream.discard()
            raise


def skeletons_frame(item: TrackedPoseSet) -> dict[str, Any]:
    """Return one entry of "frames"."""
    people = [_person(item, k) for k in range(len(item.ids))]
    return {"index": item.index, "stamp_ns": item.stamp_ns, "skeletons": people}


def _person(item: TrackedPoseSet, k: int) -> dict[str, Any]:
    there = item.states[k] != JointState.MISSING
    return {
        "id": int(item.ids[k]),
        "joints": [_row(p) for p in item.positions[k]],
        "scores": item.scores[k].tolist(),
        "covariances": [c[_UPPER].tolist() if ok else None for c, ok in zip(item.covariances[k], there)],
        "views": item.views[k].tolist(),
        "states": item.states[k].tolist(),
    }


def _row(values: Array) -> list[float] | None:
    return values.tolist() if np.isfinite(values).all() else None


def _person_scores(scores: Array) -> Array:
    """Return the mean score (P,) over the joints that are present."""
    there = scores > 0.0
    scores_of_people: Array = scores.sum(1) / np.maximum(there.sum(1), 1)
    return scores_of_people


def _document(
    path: Path, wanted: str, read: Callable[[Path], Any] = read_json
) -> tuple[dict[str, Any], tuple[str, ...]]:
    if title := _foreign(Path(path)):
        raise DataError(f"{path} is {title}, which is not read; {REMEDY}")
    document = read(Path(path))
    found = document.get("format") if isinstance(document, dict) else None
    if found != wanted and (title := _foreign_document(document)):
        raise DataError(f"{path} is {title}, which is not read; {REMEDY}")
    if found != wanted:
        is_named = isinstance(document, dict) and "format" in document
        what = f"has format {shown(found)}" if is_named else "does not name its format"
        raise DataError(f"{path} {what}, expected {shown(wanted)}")
    names = document.get("joint_names")
    if not isinstance(names, list) or not names or not all(isinstance(n, str) for n in names):
        raise DataError(f"{path} has no list of joint_names")
    if len(set(names)) != len(names):
        raise DataError(f"{path} names a joint twice in joint_names")
    if not isinstance(document.get("frames"), list):
        raise DataError(f"{path} has no list of frames")
    return document, tuple(names)


def _foreign(path: Path) -> str:
    """Return the name of a folder format of another program's 2D poses; "" if it is none."""
    first = next(path.rglob("*.json"), None) if path.is_dir() else None
    if first is None:
        return ""
    try:
        return "a folder of OpenPose" if _foreign_document(read_json(first)) == FRAME else ""
    except UserError:
        return ""  # `read_detections` then reports that the path is a folder


def _foreign_document(document: Any) -> str:
    """Return the name of another program's 2D pose format; "" if the document is none."""
    first = document[0] if isinstance(document, list) and document else document
    there = set(first) if isinstance(first, dict) else set()
    return next((title for title, wanted in FOREIGN.items() if wanted <= there), "")


def _index(frame: dict[str, Any], number: int, where: str) -> int:
    """Return the index of a frame, by default its number in the file."""
    return _integer(frame.get("index", number), where, "index")


def _integer(value: Any, where: str, key: str = "stamp_ns") -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise DataError(f"{where}: {key} = {shown(value)} is not an integer")
    if not -(2**63) <= value < 2**63:
        raise DataError(f"{where}: {key} = {shown(value)} is out of range: it does not fit into 64 bits")
    return value


def _joint_rows(
    persons: list[Any], joints: int, width: int, where: str, scored: bool = True
) -> tuple[Array, Array]:
    """Return points (P, joints, 2 or 3) and scores (P, joints) from rows of numbers or null.

    Args:
        width: numbers of a joint.
        scored: the third number is a score in 0..1; otherwise the score is 1 for a present joint, else 0.
    """
    nothing = [np.nan] * width
    for k, person in enumerate(persons):
        if len(person) != joints:
            raise DataError(f"{where}: person {k} has {len(person)} joints, joint_names has {joints}")
    try:
        rows = np.array([[joint or nothing for joint in person] for person in persons], float)
        rows = rows.reshape(len(persons), joints, width)
    except (TypeError, ValueError, OverflowError):
        raise DataError(f"{where}: a joint is neither null nor {width} numbers") from None
    if np.isinf(rows).any():
        raise DataError(f"{where}: a joint has a number that is not finite")
    if not scored:
        return rows, np.isfinite(rows).all(-1).astype(float)
    scores = np.nan_to_num(rows[..., 2])
    if scores.size and not 0.0 <= scores.min() <= scores.max() <= HIGHEST_SCORE:
        raise DataError(f"{where}: a score lies outside of 0..1 ({scores.min():g} to {scores.max():g})")
    scores = np.minimum(scores, 1.0)
    points = np.where((scores > 0.0)[..., None], rows[..., :2], np.nan)
    scores = np.where(np.isfinite(points).all(-1), scores, 0.0)
    return points, scores


class SkeletonStream(FrameStream):
    """Writer of 3D poses frame by frame, in the format of `write_skeletons`.

    Args:
        packed, named: see `FrameStream`.

    Raises:
        EnvironmentProblem: if the file cannot be written.
    """

    def __init__(
        self, path: Path, joint_names: Iterable[str], packed: bool = True, named: Path | None = None
    ):
        super().__init__(path, {"format": SKELETONS, "joint_names": list(joint_names)}, packed, named)

    def take(self, item: TrackedPoseSet) -> None:
        """Append one frame."""
        self.add(skeletons_frame(item))
