"""A thread that does a node's heavy work, so that its callbacks only enqueue."""
from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Any

from panoptic_ros.errors import PanopticError


class Worker:
    """Takes items in order, one at a time.

    Args:
        work: called for every item.
        limit: of waiting items per key; beyond it the oldest of that key is dropped.
        on_drop: called with the key of every item that was dropped.
    """

    def __init__(
        self,
        work: Callable[[Any], None],
        limit: int | None = None,
        on_drop: Callable[[str], None] = lambda key: None,
    ):
        self._work = work
        self._limit = limit
        self._on_drop = on_drop
        self._items: deque[tuple[str, Any]] = deque()
        self._changed = threading.Condition()
        self._stopping = False
        self.fault: PanopticError | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def put(self, key: str, item: Any, droppable: bool = True) -> None:
        """Enqueue an item; `droppable` ones count against the limit."""
        dropped = False
        with self._changed:
            if self._limit is not None and droppable:
                waiting = [i for i, entry in enumerate(self._items) if entry[0] == key]
                if len(waiting) >= self._limit:
                    del self._items[waiting[0]]
                    dropped = True
            self._items.append((key, item))
            self._changed.notify()
        if dropped:
            self._on_drop(key)

    @property
    def alive(self) -> bool:
        """Whether it still works; False after a fault, and after a bug, which prints its traceback."""
        return self._thread.is_alive()

    def stop(self) -> None:
        """Finish the item at hand and end."""
        with self._changed:
            self._stopping = True
            self._changed.notify()
        self._thread.join(timeout=5.0)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._items or self._stopping)
                if self._stopping:
                    return
                _, item = self._items.popleft()
            try:
                self._work(item)
            except PanopticError as error:
                self.fault = error
                return
