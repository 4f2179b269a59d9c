"""Live: images of a few instants under work side by side, so that no camera waits for another one's look.

Work that waits in lines: of each line one thing after the other, of all lines side by side.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future, wait
from typing import Any

from panoptic_ros.graph.pipeline import Pipeline

Work = tuple["Future[Any]", Callable[[], Any]]


class Lines:
    """What is done on a pool for cameras that must not wait for each other, each image after the one before.

    Args:
        pool: whoever is free takes what has waited longest, of those lines that nobody works on.
    """

    def __init__(self, pool: Executor):
        self._pool = pool
        self._lines: dict[str, deque[Work]] = {}  # those on which somebody works
        self._changing = threading.Lock()

    def add(self, line: str, call: Callable[[], Any]) -> Future[Any]:
        """Do this once all that was added to the line before is done."""
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
        except BaseException as error:  # is raised again where the result is taken
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


INSTANTS = 2  # under way at most: while a long look at one camera goes on, the others go on to the next


class UnderWay:
    """Lets a pipeline begin with records on the threads of a pool, and hands them on when they are done.

    Of each camera one comes after the other; cameras overtake each other. All methods are called on one
    thread, which also does what `note` takes.

    Args:
        pool: None: one record after the other.
        note: takes calls from any thread, to be done on that one.
    """

    def __init__(self, pipeline: Pipeline, pool: Executor | None, note: Callable[[Callable[[], None]], None]):
        self._pipeline, self._note = pipeline, note
        self._lines = None if pool is None else Lines(pool)
        self._instants: list[set[Future[Any]]] = []

    @property
    def full(self) -> bool:
        """Whether no other instant should begin."""
        return len(self._instants) >= INSTANTS

    def waited(self, ns: int) -> None:
        """The records of the next instant have waited for so long."""
        self._pipeline.waited(ns)

    def arrived(self, came_ns: int, host_ns: int) -> None:
        """Tell the arrival of the records of the next instant (see `stage.Timed`)."""
        self._pipeline.arrived(came_ns, host_ns)

    def begin(self, records: Sequence[tuple[str, Any]]) -> None:
        """Take records of one instant, with their topics. What stands beside a record of its camera, such as
        its depth map, comes before it.
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
        """Until no stage is at work."""
        wait([step for instant in self._instants for step in instant])

    def _tell(self, topic: str, record: Any, step: Future[Any], instant: set[Future[Any]]) -> None:
        step.add_done_callback(lambda done: self._note(lambda: self._end(topic, record, done, instant)))

    def _end(self, topic: str, record: Any, step: Future[Any], instant: set[Future[Any]]) -> None:
        instant.discard(step)
        self._instants = [left for left in self._instants if left]
        self._pipeline.push(topic, record)
