"""`panoptic view`: recordings in a page of any browser."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from panoptic_ros.errors import UsageError
from panoptic_ros.io.files import read_json
from panoptic_ros.io.folders import MARK
from panoptic_ros.io.interruption import first_request_told
from panoptic_ros.io.skeletons import load_skeleton
from panoptic_ros.view.page.recorded import RecordedScene
from panoptic_ros.view.page.recorded_talk import RecordedTalk
from panoptic_ros.view.page.server import PageServer

LOOK_S = 0.2
Ready = Callable[[str], None]  # called with the address of the page


def open_recorded(path: Path, rig: Path | None = None, skeleton: str = "") -> RecordedScene:
    """The results of a run, or a bag, to be looked at.

    Args:
        rig, skeleton: in place of what the bag says.

    Raises:
        UserError: if there is nothing to be seen at `path`.
    """
    path = Path(path)
    given: dict[str, Any] = {}
    if rig is not None:
        from panoptic_ros.io.rigs import read_rig  # needs scipy, which takes long to load

        given["rig"] = read_rig(rig)
    if skeleton:
        given["skeleton"] = load_skeleton(skeleton)
    if not path.exists():
        raise UsageError(f"there is no {path}; give the results of `panoptic run`, a bag or a capture folder")
    if (path / MARK).is_file():
        bag = path / "bag"
        if not bag.exists():
            raise UsageError(f"{path} has a {MARK} but no bag/: run `panoptic run` again")
        return RecordedScene(bag, path.resolve().name, report=read_json(path / MARK), **given)
    return RecordedScene(path, path.resolve().name, **given)


def view_recorded(scene: RecordedScene, host: str, port: int, ready: Ready) -> None:
    """Serve a recording until somebody ends it.

    Raises:
        EnvironmentProblem: if nothing can listen there.
    """
    with first_request_told(True) as asked:
        asyncio.run(_serve_recorded(scene, host, port, ready, asked))
    scene.close()


async def _serve_recorded(
    scene: RecordedScene, host: str, port: int, ready: Ready, asked: Callable[[], bool]
) -> None:
    talk = RecordedTalk(scene)
    async with PageServer(talk, host, port).listening() as address:
        loop, stop = asyncio.get_running_loop(), threading.Event()
        ready(address)

        def told() -> None:
            asyncio.run_coroutine_threadsafe(talk.tell_presence(), loop)

        scanning = asyncio.create_task(asyncio.to_thread(scene.scan, stop.is_set, told))
        try:
            while not asked():
                await asyncio.sleep(LOOK_S)
        finally:
            stop.set()
            await scanning
