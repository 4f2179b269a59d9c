"""`panoptic view`: recordings in a page of any browser."""

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
from panoptic_ros.running.viewer.plain_results import PlainScene, plain_file
from panoptic_ros.view.page.recorded import RecordedScene
from panoptic_ros.view.page.recorded_talk import RecordedTalk
from panoptic_ros.view.page.server import PageServer
from panoptic_ros.view.page.truth import Truth

if TYPE_CHECKING:
    from panoptic_ros.view.page.folder import FolderScene

TRUTH = "truth.json.gz"  # of a simulated capture folder
LOOK_S = 0.2
DRAWING_S = 1.0  # that a browser has the processors to itself for its first picture
Ready = Callable[[str], None]  # called with the address of the page


def open_recorded(
    path: Path, rig: Path | None = None, skeleton: str = "", truth: Path | None = None
) -> RecordedScene | FolderScene:
    """The results of a run or of `solve`, a bag, or a capture folder, to be looked at.

    Args:
        rig, skeleton: in place of what the bag or folder says.
        truth: a file of skeletons in the plain format; of a capture folder its own `truth.json.gz`, if any.

    Raises:
        UserError: if there is nothing to be seen at `path`.
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
    kept = path / "bag" / "metadata.yaml"  # of a take that was repaired, which has no report
    if path.is_file() and (plain := plain_file(path)) is not None:
        return _open_plain(plain, rig, skeleton, truth)
    if path.is_dir() and not any(p.is_file() for p in (path / MARK, path / "metadata.yaml", kept)):
        from panoptic_ros.capture import has_media  # needs decoders, which results do without

        if not has_media(path) and (plain := plain_file(path)) is not None:
            return _open_plain(plain, rig, skeleton, truth)
        return _open_folder(path, rig, skeleton, truth)
    given: dict[str, Any] = {}
    if rig is not None:
        from panoptic_ros.io.rigs import read_rig  # needs scipy, which takes long to load

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
    from panoptic_ros.capture import open_capture_folder  # needs decoders, which results do without
    from panoptic_ros.io.rigs import read_rig
    from panoptic_ros.view.page.folder import FolderScene

    folder = open_capture_folder(path, rig=None if rig is None else read_rig(rig))
    model = load_skeleton(skeleton or DEFAULT_SKELETON)
    own = path / TRUTH
    known = truth if truth is not None else own if own.is_file() else None
    people = None if known is None else Truth(read_skeletons(known), model)
    return FolderScene(folder, path.resolve().name, model, people)


def view_recorded(scene: RecordedScene | FolderScene, host: str, port: int, ready: Ready) -> None:
    """Serve a recording until somebody ends it.

    Raises:
        EnvironmentProblem: if nothing can listen there.
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
