"""Live cameras that a node reads itself, each in a thread of its own."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from contextlib import closing
from typing import Any

from panoptic_ros.capture import open_source
from panoptic_ros.domain import Rig, ViewFrame
from panoptic_ros.errors import PanopticError
from panoptic_ros.nodes.stages.own_cameras import OwnCameras, OwnInput


class LiveCameras:
    """Reads live cameras, each in a thread of its own.

    Args:
        take: called with (input, image), on that thread.
        failed: called with what ended a camera.
    """

    def __init__(
        self,
        own: OwnCameras,
        rig: Rig,
        inputs: Mapping[str, OwnInput],
        sent: Callable[[Any], None],
        take: Callable[[OwnInput, ViewFrame], None],
        failed: Callable[[PanopticError], None],
    ):
        self._own, self._rig, self._inputs = own, rig, inputs
        self._sent, self._take, self._failed = sent, take, failed
        self._stopping = threading.Event()
        self._sources: dict[str, Any] = {}
        self._threads = [
            threading.Thread(target=self._read, args=(camera,), name=f"camera {camera}", daemon=True)
            for camera in own.sources
        ]
        for thread in self._threads:
            thread.start()

    def _read(self, camera: str) -> None:
        try:
            source, _ = open_source(camera, self._rig, self._own.sources[camera])
            with closing(source):
                self._sources[camera], entry = source, self._inputs[camera]
                for frame in source:
                    if self._stopping.is_set():
                        return
                    self._sent(frame)
                    self._take(entry, frame)
                    entry.arrivals.cpu_ns = time.thread_time_ns()
        except PanopticError as error:
            self._failed(error)

    def close(self) -> None:
        """End the threads and close the devices."""
        self._stopping.set()
        for source in list(self._sources.values()):
            source.close()
        for thread in self._threads:
            thread.join(timeout=5.0)
