"""Parallel detection for the cameras of a recording: the network runs in one thread per core.

Detections of different cameras are independent, unless tracking guides the detector. So threads process the
cameras in any order, a few images ahead of the pipeline. In the pipeline, a replacement stage gives the
results that are already there. All output is identical to that of one thread, byte for byte. Networks, video
decoders and image operations release Python's global lock, so threads are sufficient. Processes would need
copies of the images.
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

AHEAD = 2  # images per camera that may always wait with their results
# 64 MiB of images of all cameras; below this more images may wait, while other stages load their kernels
HELD = 1 << 26
TABLE: Mapping[str, NodeSpec] = {
    **NODES,
    "detection": replace(NODES["detection"], stage=f"{__name__}:PrecomputedDetection"),
}


class _DetectionResult(NamedTuple):
    """Image with the result of the stage, or the error if the stage refused it."""

    frame: ViewFrame
    result: StepResult[ViewDetections] | DataError
    duration_ns: int


class PrecomputedDetection:
    """Replacement of the detection stage: it gives the results of `ParallelDetection`, the extra "looks"."""

    def __init__(self, config: Config, context: StageContext):
        self._looks: ParallelDetection = context.extras["looks"]

    def step(self, item: ViewFrame) -> StepResult[ViewDetections]:
        """Return the result for an image.

        Raises:
            DataError: if the stage refused the image.
        """
        return self._looks.take(item)

    def flush(self) -> StepResult[ViewDetections]:
        """Return no records: nothing is buffered."""
        return StepResult()

    def reset(self) -> None:
        """Do nothing: there is no state."""

    def forget(self) -> None:
        """Do nothing: there is no state."""

    def state(self) -> bytes:
        """Return an empty state."""
        return b""

    def begin(self, state: bytes) -> None:
        """Do nothing: there is no state."""


class ParallelDetection:
    """Context manager that runs a detection stage over the images of several cameras in threads.

    The threads end when the context is left.

    Args:
        stage: Detection stage.
        inputs: Records of each camera, in the order of the stage: depth maps before their images.
        threads: Most threads.
        clock: Returns a monotonic time in ns.
    """

    def __init__(
        self,
        stage: Stage[Any, ViewDetections],
        inputs: Mapping[str, Iterator[ViewFrame | DepthFrame]],
        threads: int,
        clock: Callable[[], int],
    ):
        self._stage, self._inputs, self._clock = stage, inputs, clock
        self._ready: dict[str, deque[_DetectionResult]] = {name: deque() for name in inputs}
        # results passed on to the pipeline
        self._given: dict[str, deque[_DetectionResult]] = {name: deque() for name in inputs}
        self._held = 0  # size of the waiting images, bytes
        self._busy: set[str] = set()
        self._ended: set[str] = set()
        self._changed = threading.Condition()
        self._closed = False
        self._fault: BaseException | None = None
        self.duration_ns = 0  # duration of the result that was taken last
        self._threads = [
            threading.Thread(target=self._work, name=f"detection-{k}", daemon=True)
            for k in range(min(threads, max(len(inputs), 1)))
        ]

    def __enter__(self) -> ParallelDetection:
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
        """Yield the images of a camera, each as soon as its detection is done.

        Raises:
            any error of a source or the stage, except for refusals by the stage.
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
        """Return the result for the next image of a camera; see `PrecomputedDetection.step`."""
        look = self._given[frame.camera].popleft()
        self.duration_ns = look.duration_ns
        if isinstance(look.result, DataError):
            raise look.result
        return look.result

    def _work(self) -> None:
        try:
            while (camera := self._next()) is not None:
                self._look(camera)
        except BaseException as fault:  # raised again where the images are taken
            with self._changed:
                self._fault = self._fault or fault
                self._changed.notify_all()

    def _next(self) -> str | None:
        """Return the idle camera with the fewest waiting images; None if all work is done."""
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
        """Run the stage on the next image of a camera."""
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

    def _step(self, frame: ViewFrame) -> _DetectionResult:
        start = self._clock()
        try:
            result: StepResult[ViewDetections] | DataError = self._stage.step(frame)
        except DataError as error:
            result = error
        return _DetectionResult(frame, result, self._clock() - start)


def looked_ahead(
    records: dict[tuple[str, str], Iterator[Any]],
    stage: Stage[Any, ViewDetections],
    threads: int,
    clock: Callable[[], int],
) -> ParallelDetection:
    """Make a detection stage run ahead on the records of cameras, by (topic, camera).

    In `records`, images are replaced by images with finished detection, and their depth maps are removed.
    """
    cameras = [owner for topic, owner in records if topic == "image"]
    inputs = {name: by_stamp(records["image", name], records.pop(("depth", name), None)) for name in cameras}
    looks = ParallelDetection(stage, inputs, threads, clock)
    records.update({("image", camera): looks.frames(camera) for camera in cameras})
    return looks


def by_stamp(images: Iterator[Any], depths: Iterator[Any] | None) -> Iterator[Any]:
    """Return the records that the stage takes from a camera, in the order of the pipeline."""
    if depths is None:
        return images
    return heapq.merge(depths, images, key=_place)


def _place(item: ViewFrame | DepthFrame) -> int:
    return item.stamp_ns - (DEPTH.ahead_ns if isinstance(item, DepthFrame) else 0)
