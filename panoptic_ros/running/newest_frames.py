"""The newest frames of several live cameras, instant by instant, in one process."""
from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from panoptic_ros.errors import PanopticError
from panoptic_ros.graph.queues import NewestInstant


def newest_frames(
    cameras: Iterable[str],
    frames: Callable[[str], Iterator[Any]],
    stop: Callable[[], bool],
    on_drop: Callable[[int], None],
) -> Iterator[Any]:
    """What the cameras give, as the detection node would take it when it falls behind.

    Args:
        frames: the frames of a camera; called in a thread for each.
        stop: asked often, also while nothing comes.
        on_drop: told how many frames were overtaken.

    Raises:
        PanopticError: what ended a camera.
    """
    names = list(cameras)
    waiting, changed, over = NewestInstant(names), threading.Condition(), threading.Event()
    faults: list[PanopticError] = []
    dropped: list[int] = []
    ended: list[str] = []

    def read(camera: str) -> None:
        try:
            for item in frames(camera):
                if over.is_set():
                    return
                with changed:
                    dropped.append(waiting.put(camera, item.stamp_ns, item))
                    changed.notify()
        except PanopticError as error:
            faults.append(error)
        finally:
            ended.append(camera)

    for name in names:
        threading.Thread(target=read, args=(name,), daemon=True).start()
    try:
        while not stop():
            with changed:
                batch = waiting.take()
                if not batch:
                    changed.wait(0.2)
                lost = sum(dropped)
                dropped.clear()
            if lost:
                on_drop(lost)
            if faults:
                raise faults[0]
            if not batch and len(ended) == len(names):
                return
            yield from batch
    finally:
        over.set()
