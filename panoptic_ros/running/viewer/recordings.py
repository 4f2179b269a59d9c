"""Shows recordings in a web page, for `panoptic view`.

A plain file of skeletons, as `panoptic solve` writes it, is converted into a bag in a temporary folder. That
folder exists as long as the scene.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from panoptic_ros.errors import UsageError
from panoptic_ros.io.files import read_json
from panoptic_ros.io.folders import MARK
from panoptic_ros.io.interruption import first_request_told
from panoptic_ros.io.plain_formats import read_skeletons
from panoptic_ros.io.skeletons import DEFAULT_SKELETON, load_skeleton
from panoptic_ros.io.takes import is_recorded_now, unclosed_take
from panoptic_ros.view.page.recorded import RecordedScene
from panoptic_ros.view.page.recorded_talk import RecordedTalk
from panoptic_ros.view.page.server import PageServer
from panoptic_ros.view.page.truth import TruthSkeletons

if TYPE_CHECKING:
    from panoptic_ros.view.page.folder import FolderScene


from collections.abc import Sequence
from tempfile import TemporaryDirectory

import numpy as np

from panoptic_ros.domain import JointState, RefinedPoseSet, Rig, SkeletonModel
from panoptic_ros.errors import DataError, UserError
from panoptic_ros.io.bags import BagWriter
from panoptic_ros.io.loading import parsing
from panoptic_ros.io.messages import bag_messages, to_message
from panoptic_ros.io.plain_formats import PlainSkeletonFrame, PlainSkeletons
from panoptic_ros.io.rigs import find_rig, read_rig
from panoptic_ros.io.skeletons import (
    in_vocabulary,
    shared_names,
    skeleton_of,
)

TRUTH = "truth.json.gz"  # truth file of a simulated capture folder
LOOK_S = 0.2
DRAWING_S = 1.0  # s; the scan waits, so that the browser has the processors for its first picture
Ready = Callable[[str], None]  # called with the address of the page
Array = np.ndarray
NAMES = ("skeletons.json.gz", "skeletons.json")  # names of skeleton files in a folder
SUFFIXES = (".json", ".json.gz")
LEAST_SCORE = 1e-3  # minimum score of a joint with a position


def plain_file(path: Path) -> Path | None:
    """Return the skeleton file at a path: the path itself, or a file in that folder; None if absent."""
    if path.is_file():
        return path if path.name.endswith(SUFFIXES) else None
    return next((path / name for name in NAMES if (path / name).is_file()), None)


class PlainScene(RecordedScene):
    """Scene of the skeletons of a plain file.

    Args:
        rig: replaces the rig beside the file; None = use that one.
        truth: see `RecordedScene`.

    Raises:
        UserError: if the file cannot be read, or there is no rig.
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
        raise DataError("it has no frames, so there is nothing to show")
    first = min(frame.stamp_ns for frame in plain.frames)
    family = bag_messages()
    with BagWriter(path) as bag:
        bag.write("/rig", first, to_message(rig, family, rig.frame_id))
        bag.write("/skeleton_model", first, to_message(model, family, rig.frame_id))
        for frame in plain.frames:
            record = _poses(frame, np.array(order), model)
            bag.write("/skeletons", frame.stamp_ns, to_message(record, family, rig.frame_id))


def _poses(frame: PlainSkeletonFrame, order: Array, model: SkeletonModel) -> RefinedPoseSet:
    """Return the skeletons of a frame with joints in the order of the model. Unknown covariances are 0."""
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
    """Return the skeleton model for `joint_names`, and the index of each of its joints in `joint_names`."""
    found = skeleton_of(joint_names)
    words = in_vocabulary(joint_names)
    if found is not None:
        return load_skeleton(found), [words.index(word) for word in shared_names(found)]
    return _tree(tuple(joint_names), words), list(range(len(joint_names)))


def _tree(names: tuple[str, ...], words: Sequence[str]) -> SkeletonModel:
    """Return a skeleton model for joints of no installed skeleton.

    Each joint is connected to its nearest ancestor in the default skeleton that is present.
    """
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


def open_recorded(
    path: Path, rig: Path | None = None, skeleton: str = "", truth: Path | None = None
) -> RecordedScene | FolderScene:
    """Open the results of a run or of `solve`, a bag, or a capture folder for viewing.

    Args:
        rig, skeleton: replace those of the bag or folder.
        truth: plain file of skeletons; None = `truth.json.gz` of a capture folder, if it exists.

    Raises:
        UserError: if there is nothing to view at `path`.
    """
    path = Path(path)
    if not path.exists():
        raise UsageError(
            f"there is no {path}; give the results of `panoptic run` or `solve`, a bag or a capture folder"
        )
    if is_recorded_now(path):
        raise UsageError(f"{path} is being recorded now; `panoptic view --live` shows the graph")
    if (take := unclosed_take(path) or unclosed_take(path.parent)) is not None:
        raise UsageError(f"{take}; then view that")
    kept = path / "bag" / "metadata.yaml"  # a repaired take has a bag but no report
    if path.is_file() and (plain := plain_file(path)) is not None:
        return _open_plain(plain, rig, skeleton, truth)
    if path.is_dir() and not any(p.is_file() for p in (path / MARK, path / "metadata.yaml", kept)):
        from panoptic_ros.capture import has_media  # imports decoders, which results do not need

        if not has_media(path) and (plain := plain_file(path)) is not None:
            return _open_plain(plain, rig, skeleton, truth)
        return _open_folder(path, rig, skeleton, truth)
    given: dict[str, Any] = {}
    if rig is not None:
        from panoptic_ros.io.rigs import read_rig  # imports scipy, which is slow to load

        given["rig"] = read_rig(rig)
    if skeleton:
        given["skeleton"] = load_skeleton(skeleton)
    if truth is not None:
        given["truth"] = read_skeletons(truth)
    if (path / MARK).is_file():
        bag = path / "bag"
        if not bag.exists():
            raise UsageError(f"{path} has a {MARK} but no bag/: run `panoptic run` again")
        return RecordedScene(bag, path.resolve().name, report=read_json(path / MARK), **given)
    return RecordedScene(path / "bag" if kept.is_file() else path, path.resolve().name, **given)


def _open_plain(path: Path, rig: Path | None, skeleton: str, truth: Path | None) -> RecordedScene:
    """Open the skeletons of a plain file."""
    from panoptic_ros.io.rigs import read_rig

    if skeleton:
        raise UsageError(f"--skeleton has no meaning for {path}, which names its joints")
    cameras = None if rig is None else read_rig(rig)
    return PlainScene(path, cameras, None if truth is None else read_skeletons(truth))


def _open_folder(path: Path, rig: Path | None, skeleton: str, truth: Path | None) -> FolderScene:
    from panoptic_ros.capture import open_capture_folder  # imports decoders, which results do not need
    from panoptic_ros.io.rigs import read_rig
    from panoptic_ros.view.page.folder import FolderScene

    folder = open_capture_folder(path, rig=None if rig is None else read_rig(rig))
    model = load_skeleton(skeleton or DEFAULT_SKELETON)
    own = path / TRUTH
    known = truth if truth is not None else own if own.is_file() else None
    people = None if known is None else TruthSkeletons(read_skeletons(known), model)
    return FolderScene(folder, path.resolve().name, model, people)


def view_recorded(scene: RecordedScene | FolderScene, host: str, port: int, ready: Ready) -> None:
    """Serve a recording until a request to end.

    Raises:
        EnvironmentProblem: if the address cannot be opened for listening.
    """
    with first_request_told(True) as asked:
        asyncio.run(_serve_recorded(scene, host, port, ready, asked))
    scene.close()


async def _serve_recorded(
    scene: RecordedScene | FolderScene, host: str, port: int, ready: Ready, asked: Callable[[], bool]
) -> None:
    talk = RecordedTalk(scene)
    async with PageServer(talk, host, port).listening() as address:
        loop, stop = asyncio.get_running_loop(), threading.Event()
        ready(address)

        def told() -> None:
            asyncio.run_coroutine_threadsafe(talk.tell_presence(), loop)

        async def scan() -> None:
            if not scene.is_read_by_scan:
                await talk.shown.wait()
                await asyncio.sleep(DRAWING_S)
            await asyncio.to_thread(scene.scan, stop.is_set, told)

        scanning = asyncio.create_task(scan())
        try:
            while not asked():
                await asyncio.sleep(LOOK_S)
        finally:
            stop.set()
            talk.shown.set()
            await scanning
