"""Parallel processing of live images.

A few instants are under way at a time, so no camera waits for the detection of another camera. Work is queued
in lines. Tasks of one line run one after the other, and tasks of different lines run in parallel.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future, wait
from typing import Any

from panoptic_ros.graph.pipeline import Pipeline

Work = tuple["Future[Any]", Callable[[], Any]]


class CameraTaskQueues:
    """Task queues on a thread pool, one per camera: tasks of a camera run in order, cameras in parallel.

    Args:
        pool: A free thread takes the task that has waited longest, of the lines without a running task.
    """

    def __init__(self, pool: Executor):
        self._pool = pool
        self._lines: dict[str, deque[Work]] = {}  # lines with a running task, and their waiting tasks
        self._changing = threading.Lock()

    def add(self, line: str, call: Callable[[], Any]) -> Future[Any]:
        """Run a call after all earlier calls of its line; return its future."""
        future: Future[Any] = Future()
        with self._changing:
            idle = line not in self._lines
            self._lines.setdefault(line, deque()).append((future, call))
        if idle:
            self._pool.submit(self._do_next, line)
        return future

    def _do_next(self, line: str) -> None:
        with self._changing:
            future, call = self._lines[line].popleft()
        try:
            result = call()
        except BaseException as error:  # raised again where the result is taken
            self._go_on(line)
            future.set_exception(error)
        else:
            self._go_on(line)
            future.set_result(result)

    def _go_on(self, line: str) -> None:
        with self._changing:
            if not self._lines[line]:
                del self._lines[line]
                return
        self._pool.submit(self._do_next, line)


# most instants under way: during a long detection of one camera, the others start their next image
INSTANTS = 2


class ParallelPipeline:
    """Parallel start of records on a thread pool; finished records are passed on through the pipeline.

    Records of one camera stay in order, but cameras overtake each other. All methods are called on one
    thread, which also runs the calls passed to `note`.

    Args:
        pool: None: one record at a time.
        note: Schedules a call on that thread; any thread may use it.
    """

    def __init__(self, pipeline: Pipeline, pool: Executor | None, note: Callable[[Callable[[], None]], None]):
        self._pipeline, self._note = pipeline, note
        self._lines = None if pool is None else CameraTaskQueues(pool)
        self._instants: list[set[Future[Any]]] = []

    @property
    def full(self) -> bool:
        """Return whether no further instant should begin."""
        return len(self._instants) >= INSTANTS

    def waited(self, ns: int) -> None:
        """Report how long the records of the next instant have waited."""
        self._pipeline.waited(ns)

    def arrived(self, came_ns: int, host_ns: int) -> None:
        """Report the arrival of the records of the next instant (see `stage.ArrivalAwareStage`)."""
        self._pipeline.arrived(came_ns, host_ns)

    def begin(self, records: Sequence[tuple[str, Any]]) -> None:
        """Process records of one instant, given with their topics.

        Companions of a record, such as its depth map, are processed first.
        """
        instant: set[Future[Any]] = set()
        others = [item for item in records if not self._pipeline.is_beside(item[0])]
        for topic, record in (item for item in records if self._pipeline.is_beside(item[0])):
            self._pipeline.push(topic, record)
        for topic, record in others:
            step = None if self._lines is None else self._pipeline.begin_step(topic, record, self._lines.add)
            if step is None:
                self._pipeline.push(topic, record)
            else:
                instant.add(step)
                self._tell(topic, record, step, instant)
        if instant:
            self._instants.append(instant)

    def wait(self) -> None:
        """Wait until no stage is busy."""
        wait([step for instant in self._instants for step in instant])

    def _tell(self, topic: str, record: Any, step: Future[Any], instant: set[Future[Any]]) -> None:
        step.add_done_callback(lambda done: self._note(lambda: self._end(topic, record, done, instant)))

    def _end(self, topic: str, record: Any, step: Future[Any], instant: set[Future[Any]]) -> None:
        instant.discard(step)
        self._instants = [left for left in self._instants if left]
        self._pipeline.push(topic, record)
