"""Skeletons in a plain file, as `panoptic solve` writes it, as a scene.

They are written into a bag in a temporary folder, which lasts as long as the scene.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from panoptic_ros.domain import JointState, RefinedPoseSet, Rig, SkeletonModel
from panoptic_ros.errors import DataError, UsageError, UserError
from panoptic_ros.io.bags import BagWriter
from panoptic_ros.io.loading import parsing
from panoptic_ros.io.messages import bag_messages, to_message
from panoptic_ros.io.plain_formats import PlainSkeletonFrame, PlainSkeletons, read_skeletons
from panoptic_ros.io.rigs import find_rig, read_rig
from panoptic_ros.io.skeletons import (
    DEFAULT_SKELETON,
    in_vocabulary,
    load_skeleton,
    shared_names,
    skeleton_of,
)
from panoptic_ros.view.page.recorded import RecordedScene

Array = np.ndarray
NAMES = ("skeletons.json.gz", "skeletons.json")  # in a folder
SUFFIXES = (".json", ".json.gz")
LEAST_SCORE = 1e-3  # of a joint that is there


def plain_file(path: Path) -> Path | None:
    """Return the file of skeletons at a path: itself, or the one in the folder; None if there is none."""
    if path.is_file():
        return path if path.name.endswith(SUFFIXES) else None
    return next((path / name for name in NAMES if (path / name).is_file()), None)


class PlainScene(RecordedScene):
    """The skeletons of a file.

    Args:
        rig: in place of one beside the file. truth: see `RecordedScene`.

    Raises:
        UserError: if the file cannot be read, or no rig is there.
    """

    def __init__(self, path: Path, rig: Rig | None, truth: PlainSkeletons | None = None):
        self._folder = TemporaryDirectory(prefix="panoptic-view-")
        try:
            plain = read_skeletons(path)
            model, order = _model_of(plain.joint_names)
            cameras = _rig_beside(path) if rig is None else rig
            with parsing(path):
                _write_bag(Path(self._folder.name) / "bag", plain, order, model, cameras)
            super().__init__(Path(self._folder.name) / "bag", path.resolve().name, truth=truth)
        except BaseException:
            self._folder.cleanup()
            raise

    def close(self) -> None:
        """Close the bag and remove it."""
        super().close()
        self._folder.cleanup()


def _rig_beside(path: Path) -> Rig:
    try:
        return read_rig(find_rig(path.resolve().parent))
    except UserError as error:
        raise UsageError(f"{path}: the rig of these skeletons is not known ({error}); give --rig") from None


def _write_bag(
    path: Path, plain: PlainSkeletons, order: Sequence[int], model: SkeletonModel, rig: Rig
) -> None:
    if not plain.frames:
        raise DataError("it has no frames, so there is nothing to be seen")
    first = min(frame.stamp_ns for frame in plain.frames)
    family = bag_messages()
    with BagWriter(path) as bag:
        bag.write("/rig", first, to_message(rig, family, rig.frame_id))
        bag.write("/skeleton_model", first, to_message(model, family, rig.frame_id))
        for frame in plain.frames:
            record = _poses(frame, np.array(order), model)
            bag.write("/skeletons", frame.stamp_ns, to_message(record, family, rig.frame_id))


def _poses(frame: PlainSkeletonFrame, order: Array, model: SkeletonModel) -> RefinedPoseSet:
    """Return the skeletons of a frame with joints in the order of the model; unknown covariances are 0."""
    positions, scores, views = (part[:, order] for part in (frame.positions, frame.scores, frame.views))
    there = np.isfinite(positions).all(-1)
    covariances = np.where(there[..., None, None], np.nan_to_num(frame.covariances[:, order]), np.nan)
    scores = np.where(there, np.clip(scores, LEAST_SCORE, 1.0), 0.0)
    seen = np.where(views == 0, JointState.PREDICTED, JointState.MEASURED)
    states = np.where(there, seen, JointState.MISSING)
    return RefinedPoseSet(
        frame.index,
        frame.stamp_ns,
        model.hash,
        positions,
        covariances,
        scores,
        np.maximum(views, 0),
        states,
        scores.mean(1) if scores.size else np.zeros(len(scores)),
        ids=frame.ids,
    )


def _model_of(joint_names: Sequence[str]) -> tuple[SkeletonModel, list[int]]:
    """Return the skeleton of these joints, and the indices of its joints among them, in its order."""
    found = skeleton_of(joint_names)
    words = in_vocabulary(joint_names)
    if found is not None:
        return load_skeleton(found), [words.index(word) for word in shared_names(found)]
    return _tree(tuple(joint_names), words), list(range(len(joint_names)))


def _tree(names: tuple[str, ...], words: Sequence[str]) -> SkeletonModel:
    """Make a skeleton of other joints, each on the nearest joint of the usual skeleton that is there."""
    usual, spelt = load_skeleton(DEFAULT_SKELETON), shared_names(DEFAULT_SKELETON)
    at = {spelt.index(word): k for k, word in reversed(list(enumerate(words))) if word in spelt}
    parents: dict[int, int] = {}
    for joint, own in at.items():
        above = usual.parents[joint]
        while above >= 0 and above not in at:
            above = usual.parents[above]
        if above >= 0:
            parents[own] = at[above]
    root = next((k for k in at.values() if k not in parents), 0)
    bones: list[tuple[int, int]] = []
    reached, left = {root}, [k for k in range(len(names)) if k != root]
    while left:
        ready = [k for k in left if parents.get(k, root) in reached]
        bones += [(parents.get(k, root), k) for k in ready]
        reached |= {*ready}
        left = [k for k in left if k not in reached]
    head = at.get(usual.head, root)
    return SkeletonModel("joints of the file", names, root, tuple(bones), head)
