"""Detection of the cameras of a recording side by side: the network runs in a thread for every core.

Cameras do not influence each other's detections unless tracking tells where to look, so threads take them in
any order, a few images ahead of the pipeline. There the stage of the row gives what was found already: all
else is as with one thread, to the byte. Networks, decoders of videos and image operations run outside of
Python's lock, so threads do; processes would have to be sent the images.
"""

from __future__ import annotations

import heapq
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from panoptic_ros.domain import DepthFrame, ViewDetections, ViewFrame
from panoptic_ros.errors import DataError
from panoptic_ros.graph.nodes import DEPTH, NODES, NodeSpec
from panoptic_ros.params import Config
from panoptic_ros.stage import Stage, StageContext, StepResult

AHEAD = 2  # images of a camera that may wait in any case with what was found in them
HELD = 1 << 26  # bytes of images of all cameras up to which more may: while other stages load their kernels
TABLE: Mapping[str, NodeSpec] = {
    **NODES,
    "detection": replace(NODES["detection"], stage=f"{__name__}:LookedAt"),
}


class _Look(NamedTuple):
    """An image, and what the stage gave for it or why it refused it."""

    frame: ViewFrame
    result: StepResult[ViewDetections] | DataError
    duration_ns: int


class LookedAt:
    """The stage of the row of detection: hands on what `SideBySide`, extra "looks", has found."""

    def __init__(self, config: Config, context: StageContext):
        self._looks: SideBySide = context.extras["looks"]

    def step(self, item: ViewFrame) -> StepResult[ViewDetections]:
        """What was found in an image.

        Raises:
            DataError: if the stage refused it.
        """
        return self._looks.take(item)

    def flush(self) -> StepResult[ViewDetections]:
        """Nothing is buffered."""
        return StepResult()

    def reset(self) -> None:
        """Nothing is remembered."""

    def forget(self) -> None:
        """Nothing is remembered."""

    def state(self) -> bytes:
        """Nothing is remembered here."""
        return b""

    def begin(self, state: bytes) -> None:
        """Nothing is remembered here."""


class SideBySide:
    """Runs a detection stage over the images of several cameras; a context manager that ends its threads.

    Args:
        inputs: of each camera, as the stage takes them: images, depth maps before those they belong to.
        clock: a monotonic clock in ns.
    """

    def __init__(
        self,
        stage: Stage[Any, ViewDetections],
        inputs: Mapping[str, Iterator[ViewFrame | DepthFrame]],
        threads: int,
        clock: Callable[[], int],
    ):
        self._stage, self._inputs, self._clock = stage, inputs, clock
        self._ready: dict[str, deque[_Look]] = {name: deque() for name in inputs}
        self._given: dict[str, deque[_Look]] = {name: deque() for name in inputs}  # to the pipeline
        self._held = 0  # bytes of the images that are ready
        self._busy: set[str] = set()
        self._ended: set[str] = set()
        self._changed = threading.Condition()
        self._closed = False
        self._fault: BaseException | None = None
        self.duration_ns = 0  # of the look that was taken last
        self._threads = [
            threading.Thread(target=self._work, name=f"detection-{k}", daemon=True)
            for k in range(min(threads, max(len(inputs), 1)))
        ]

    def __enter__(self) -> SideBySide:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        for thread in self._threads:
            thread.join()

    def frames(self, camera: str) -> Iterator[ViewFrame]:
        """The images of a camera, each as soon as it was looked at.

        Raises:
            whatever a source or the stage raises, but for what the stage refuses.
        """
        ready = self._ready[camera]
        while True:
            with self._changed:
                self._changed.wait_for(lambda: ready or camera in self._ended or self._fault or self._closed)
                if not ready:
                    if self._fault is not None:
                        raise self._fault
                    return
                look = ready.popleft()
                self._held -= look.frame.image.nbytes
                self._changed.notify_all()
            self._given[camera].append(look)
            yield look.frame

    def take(self, frame: ViewFrame) -> StepResult[ViewDetections]:
        """What was found in the next image of a camera; see `LookedAt.step`."""
        look = self._given[frame.camera].popleft()
        self.duration_ns = look.duration_ns
        if isinstance(look.result, DataError):
            raise look.result
        return look.result

    def _work(self) -> None:
        try:
            while (camera := self._next()) is not None:
                self._look(camera)
        except BaseException as fault:  # is raised again where the images are taken
            with self._changed:
                self._fault = self._fault or fault
                self._changed.notify_all()

    def _next(self) -> str | None:
        """The free camera with the fewest images that wait; None: there is nothing more to do."""
        with self._changed:
            while not self._closed and self._fault is None:
                left = [name for name in self._inputs if name not in self._ended]
                free = [name for name in left if name not in self._busy and self._may_wait(name)]
                if free:
                    camera = min(free, key=lambda name: len(self._ready[name]))
                    self._busy.add(camera)
                    return camera
                if not left:
                    return None
                self._changed.wait()
        return None

    def _may_wait(self, camera: str) -> bool:
        return len(self._ready[camera]) < AHEAD or self._held < HELD

    def _look(self, camera: str) -> None:
        """Let the stage look at the next image of a camera."""
        item = next(self._inputs[camera], None)
        while isinstance(item, DepthFrame):
            self._stage.step(item)
            item = next(self._inputs[camera], None)
        look = None if item is None else self._step(item)
        with self._changed:
            self._busy.discard(camera)
            if look is None:
                self._ended.add(camera)
            else:
                self._ready[camera].append(look)
                self._held += look.frame.image.nbytes
            self._changed.notify_all()

    def _step(self, frame: ViewFrame) -> _Look:
        start = self._clock()
        try:
            result: StepResult[ViewDetections] | DataError = self._stage.step(frame)
        except DataError as error:
            result = error
        return _Look(frame, result, self._clock() - start)


def looked_ahead(
    records: dict[tuple[str, str], Iterator[Any]],
    stage: Stage[Any, ViewDetections],
    threads: int,
    clock: Callable[[], int],
) -> SideBySide:
    """Let a detection stage run ahead on the records of cameras, by (topic, camera): images become those that
    were looked at, and depth maps go with them.
    """
    cameras = [owner for topic, owner in records if topic == "image"]
    inputs = {name: by_stamp(records["image", name], records.pop(("depth", name), None)) for name in cameras}
    looks = SideBySide(stage, inputs, threads, clock)
    records.update({("image", camera): looks.frames(camera) for camera in cameras})
    return looks


def by_stamp(images: Iterator[Any], depths: Iterator[Any] | None) -> Iterator[Any]:
    """What the stage takes of a camera, in the order in which the pipeline hands it over."""
    if depths is None:
        return images
    return heapq.merge(depths, images, key=_place)


def _place(item: ViewFrame | DepthFrame) -> int:
    return item.stamp_ns - (DEPTH.ahead_ns if isinstance(item, DepthFrame) else 0)
