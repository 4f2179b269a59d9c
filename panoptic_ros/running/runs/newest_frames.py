"""The newest frames of several live cameras, instant by instant, and all sound, in one process."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from panoptic_ros.errors import PanopticError
from panoptic_ros.graph.queues import NewestInstant


def newest_frames(
    cameras: Iterable[str],
    frames: Callable[[str], Iterator[Any]],
    stop: Callable[[], bool],
    on_drop: Callable[[int], None],
    sounds: Sequence[Callable[[], Iterator[Any]]] = (),
) -> Iterator[Any]:
    """What the cameras give, as the detection node would take it when it falls behind.

    Args:
        frames: the frames of a camera; called in a thread for each.
        stop: asked often, also while nothing comes.
        on_drop: told how many frames were overtaken.
        sounds: what devices hear, each in a thread of its own; nothing of it is dropped. The end of one
            ends nothing.

    Raises:
        PanopticError: what ended a camera.
    """
    names = list(cameras)
    waiting, changed, over = NewestInstant(names), threading.Condition(), threading.Event()
    faults: list[PanopticError] = []
    dropped: list[int] = []
    ended: list[str] = []
    heard: list[Any] = []

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

    def listen(sound: Callable[[], Iterator[Any]]) -> None:
        try:
            for block in sound():
                if over.is_set():
                    return
                with changed:
                    heard.append(block)
                    changed.notify()
        except PanopticError as error:
            faults.append(error)

    for name in names:
        threading.Thread(target=read, args=(name,), daemon=True).start()
    for sound in sounds:
        threading.Thread(target=listen, args=(sound,), daemon=True).start()
    try:
        while not stop():
            with changed:
                all_ended = len(ended) == len(names)  # asked before what they left is taken
                batch = waiting.take()
                if not batch and not heard:
                    changed.wait(0.2)
                blocks = heard[:]
                heard.clear()
                lost = sum(dropped)
                dropped.clear()
            if lost:
                on_drop(lost)
            if faults:
                raise faults[0]
            yield from blocks
            if not batch and not blocks and all_ended:
                return
            yield from batch
    finally:
        over.set()
