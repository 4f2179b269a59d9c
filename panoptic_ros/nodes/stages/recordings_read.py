"""Recordings that a node reads itself: each record is taken when the stages want it."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from typing import Any

from panoptic_ros.capture import Note, open_recording
from panoptic_ros.domain import Rig, ViewDetections
from panoptic_ros.graph.host import Host, Key
from panoptic_ros.graph.side_by_side import SideBySide, looked_ahead
from panoptic_ros.nodes.flow.credit import STALL_S, Credit
from panoptic_ros.nodes.stages.own_cameras import OwnCameras
from panoptic_ros.stage import Stage

WAIT_S = 0.1  # for room; then the node looks whether there is something else to do


class RecordingsRead:
    """The records of cameras of a recording, taken when the stages want them.

    Args:
        sent: see `ImagesSent.send`.
        stage: looks ahead at the images of different cameras side by side; None: nobody does.
        credit: of what comes out of the graph, where stages of another process follow. Cameras then go on
            side by side, as a stage further down may wait for any of them; without, in the order of the host.
        shifts: by camera, ns: from its stamps to those of what comes out.
        note: see `open_recording`.

    Raises:
        UserError: as the opening of sources.
    """

    def __init__(
        self,
        own: OwnCameras,
        rig: Rig,
        sent: Callable[[Any], None],
        stage: Stage[Any, ViewDetections] | None,
        credit: Credit | None,
        shifts: Mapping[str, int],
        note: Note,
    ):
        self._stack, self._stopping = ExitStack(), threading.Event()
        self._credit, self._shifts = credit, shifts
        self._waited_s = 0.0
        self._taken: Counter[Key] = Counter()
        self.looks: SideBySide | None = None
        try:
            records = open_recording(rig, own.sources, self._stack, note)
            self._records = {key: _told(items, sent) for key, items in records.items()}
            if stage is not None:
                self.looks = self._stack.enter_context(
                    looked_ahead(self._records, stage, own.threads, time.perf_counter_ns)
                )
        except BaseException:
            self._stack.close()
            raise
        self.keys = frozenset(self._records)

    def fetch(self, host: Host, put: Callable[[Key, Any], None], end: Callable[[Key], None]) -> bool:
        """Hand over the record that the stages want next, or tell the end of them.

        Args:
            put: takes a record and its topic and camera. end: told of those of which no more comes.

        Returns:
            whether there is more to do; False: the stages want something else, or nothing.
        """
        key = None if self._stopping.is_set() else self._next_key(host)
        if key is None:
            return False
        if not self._has_room(key):
            return True
        record = next(self._records[key], None)
        if self._stopping.is_set():
            return False
        self._taken[key] += 1
        if record is None:
            del self._records[key]
            end(key)
            return True
        if self._credit is not None:
            self._credit.sent(key[1], record.stamp_ns + self._shifts.get(key[1], 0))
        put(key, record)
        return True

    def _next_key(self, host: Host) -> Key | None:
        if self._credit is None:
            key = host.waiting_for()
            return key if key in self._records else None
        return min(self._records, key=lambda key: self._taken[key], default=None)

    def _has_room(self, key: Key) -> bool:
        """Whether one more record may be under way; after a long time in any case, as its set may be lost."""
        if self._credit is None or self._credit.wait(key[1], WAIT_S):
            self._waited_s = 0.0
            return True
        self._waited_s += WAIT_S
        return self._waited_s >= STALL_S

    def close(self) -> None:
        """End threads and close files."""
        self._stopping.set()
        self._stack.close()


def _told(items: Iterator[Any], sent: Callable[[Any], None]) -> Iterator[Any]:
    for item in items:
        sent(item)
        yield item
