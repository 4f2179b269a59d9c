"""Worker thread of a node: it does the heavy work, so that callbacks only enqueue."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from panoptic_ros.errors import PanopticError
from panoptic_ros.graph.queues import MessageQueue
from panoptic_ros.io.kernel_cache import full_disk_told
from panoptic_ros.nodes.middleware.runtime import quiet_once


class Worker:
    """Thread that processes queued items in batches.

    Args:
        work: Called with a batch of waiting items. Items of one instant come together.
        on_drop: Called with the number of dropped items.
        fetch: Called when the queue is empty. Returns whether it found something to do.
    """

    def __init__(
        self,
        work: Callable[[list[Any]], None],
        on_drop: Callable[[int], None],
        fetch: Callable[[], bool] = lambda: False,
    ):
        self._work, self._fetch = work, fetch
        self._on_drop = on_drop
        self._waiting: MessageQueue | None = None
        self._notes: deque[Any] = deque()
        self._urgent: deque[Any] = deque()
        self._changed = threading.Condition()
        self._stopping = False
        self.fault: PanopticError | None = None
        self._thread = threading.Thread(target=self._work_on, daemon=True)

    def start(self, waiting: MessageQueue) -> None:
        """Start the thread on this queue."""
        self._waiting = waiting
        self._thread.start()

    def put(self, key: str, stamp_ns: int, item: Any) -> None:
        """Enqueue an item of a topic."""
        assert self._waiting is not None
        with self._changed:
            dropped = self._waiting.put(key, stamp_ns, item)
            self._changed.notify()
        if dropped:
            self._on_drop(dropped)

    @contextmanager
    def at_once(self) -> Iterator[None]:
        """Hold back the thread within this context: it wakes once, after all items are enqueued."""
        with self._changed:
            yield

    def note(self, item: Any) -> None:
        """Enqueue an item that must not be dropped; it is processed when no other items wait."""
        with self._changed:
            self._notes.append(item)
            self._changed.notify()

    def urge(self, item: Any) -> None:
        """Enqueue an item that must not be dropped, ahead of all waiting items."""
        with self._changed:
            self._urgent.append(item)
            self._changed.notify()

    @property
    def alive(self) -> bool:
        """Return False after a fault, or after a bug, whose traceback is printed."""
        return self._waiting is None or self._thread.is_alive()

    def stop(self) -> None:
        """Finish the current item and end the thread."""
        with self._changed:
            self._stopping = True
            self._changed.notify()
        if self._waiting is not None:
            self._thread.join(timeout=5.0)

    def _work_on(self) -> None:
        with quiet_once(lambda: self._stopping):
            self._run()

    def _run(self) -> None:
        nothing_left = False
        while True:
            with self._changed:
                batch = self._next()
                while nothing_left and not batch and not self._stopping:
                    self._changed.wait()
                    batch = self._next()
                if self._stopping:
                    return
            try:
                with full_disk_told():
                    if batch:
                        self._work(batch)
                    nothing_left = not batch and not self._fetch()
            except PanopticError as error:
                self.fault = error
                return

    def _next(self) -> list[Any]:
        assert self._waiting is not None
        if self._urgent:
            return [self._urgent.popleft()]
        return self._waiting.take() or ([self._notes.popleft()] if self._notes else [])
