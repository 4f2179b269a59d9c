"""Record incoming messages to a bag in a separate thread, with counters by topic."""

from __future__ import annotations

import os
import queue
import shutil
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from panoptic_ros.errors import ContractError, DataError, EnvironmentProblem, PanopticError
from panoptic_ros.io.bag_connections import Connection
from panoptic_ros.io.bag_split import GB, SplitLimits
from panoptic_ros.io.bags import BagWriter
from panoptic_ros.io.cdr_heads import number_in, stamp_in
from panoptic_ros.io.files import file_errors

# s, between two flushes to the disk. The queue timeout adds half of it, so a crash loses at most 0.75 s.
FLUSH_S = 0.5
# bytes that may wait in the queue while the disk is slow; further messages are dropped
MOST_WAITING = 256_000_000
NUMBERED = "panoptic_msgs/msg/ViewDetections"
# Number of timestamp steps whose median is the period of a topic without frame numbers.
FIRST_STEPS = 20
# A larger gap is not counted as missing messages: the device restarted, or its clock was set.
MOST_MISSING = 100_000


@dataclass
class TopicCounter:
    """Message counts and timestamps of one topic.

    Args:
        kind: Message type, "package/msg/Name".
        count: Messages received.
        size: Bytes received.
        missing: Messages that were lost, from gaps in the frame numbers, else from gaps in the timestamps.
        longest_s: Longest step between two successive timestamps, s.
        last_ns: Latest timestamp, ns.
    """

    kind: str
    count: int = 0
    size: int = 0
    missing: int = 0
    longest_s: float = 0.0
    last_ns: int | None = None
    _number: int | None = None
    _stepped: int = 0  # number of forward timestamp steps; `_stepped_ns` is their sum, ns
    _stepped_ns: int = 0
    _steps: list[int] = field(default_factory=list)

    def add(self, data: bytes) -> None:
        """Count one message; `data` is its CDR bytes."""
        self.count += 1
        self.size += len(data)
        stamp = stamp_in(data)
        step = 0 if stamp is None or self.last_ns is None else stamp - self.last_ns
        self.longest_s = max(self.longest_s, step * 1e-9)
        missing = self._by_number(data) if self.kind == NUMBERED else self._by_step(step)
        self.missing += missing if 0 < missing <= MOST_MISSING else 0
        if step > 0:
            self._stepped_ns, self._stepped = self._stepped_ns + step, self._stepped + 1
        if stamp is not None:
            self.last_ns = stamp

    @property
    def rate(self) -> float:
        """Return the message rate (Hz) from the timestamps; 0 if unknown."""
        return 1e9 * self._stepped / self._stepped_ns if self._stepped_ns else 0.0

    def _by_number(self, data: bytes) -> int:
        before, self._number = self._number, number_in(data)
        return 0 if before is None or self._number is None else self._number - before - 1

    def _by_step(self, step: int) -> int:
        if step <= 0:
            return 0
        if len(self._steps) < FIRST_STEPS:
            self._steps.append(step)
            return 0
        period = sorted(self._steps)[FIRST_STEPS // 2]
        return round(step / period) - 1


class BagRecorder:
    """Writer of messages to a bag, which survives a crash because it is written in place (see `BagWriter`).

    Args:
        path: The bag, or the folder of its parts.
        budget: Largest number of bytes of messages; 0 = limited by the free disk space alone.
        keep_free: Bytes that stay free on the disk.
        split: Limits of one part. The parts `path/000`, `path/001`, ... are complete bags. None = `path` is
            the bag.
        opening: Returns messages that are written at the start of every part but the first. It is called in
            the recorder's thread.
        beside: Flushes files next to the bag to the disk. It is called after each flush of the bag, in the
            recorder's thread.

    Raises:
        DataError: if `path` exists already.
    """

    def __init__(
        self,
        path: Path,
        budget: int = 0,
        keep_free: int = GB,
        split: SplitLimits | None = None,
        opening: Callable[[], Sequence[tuple[Connection, bytes]]] = tuple,
        beside: Callable[[], None] = lambda: None,
    ):
        self.counters: dict[str, TopicCounter] = {}
        self.dropped: Counter[str] = Counter()  # dropped messages by topic, because the disk was too slow
        self._path, self._split, self._opening, self._beside = path, split, opening, beside
        self._parts = 0
        self._part_size, self._part_begun_ns = 0, -1
        self._bag = self._next_bag()
        self._budget, self._keep_free = budget, keep_free
        self._size, self._waiting = 0, 0
        self._lock = threading.Lock()
        self._messages: queue.SimpleQueue[tuple[Connection, int, bytes] | None] = queue.SimpleQueue()
        self.fault: PanopticError | None = None  # error that stopped the recorder early
        self._thread = threading.Thread(target=self._write, daemon=True)
        self._thread.start()

    @property
    def path(self) -> Path:
        """Return the path of the bag, or of the folder of its parts."""
        return self._path

    @property
    def size(self) -> int:
        """Return the bytes of messages written so far."""
        return self._size

    def put(self, connection: Connection, stamp_ns: int, data: bytes) -> None:
        """Put a message into the queue; drop it if MOST_WAITING bytes are waiting.

        Args:
            stamp_ns: time of arrival, ns.
            data: CDR bytes.
        """
        with self._lock:
            if self._waiting + len(data) > MOST_WAITING:
                self.dropped[connection.topic] += 1
                return
            self._waiting += len(data)
        self._messages.put((connection, stamp_ns, data))

    def close(self) -> None:
        """Write the messages in the queue and finish the bag.

        Raises:
            PanopticError: the error that stopped the recorder, except `DiskFull`; or an error while the bag
                is closed.
        """
        self._messages.put(None)
        self._thread.join()
        if self.fault is not None and not isinstance(self.fault, DiskFull):
            self._bag.discard()
            raise self.fault
        self._bag.close()

    def _write(self) -> None:
        flushed = time.monotonic()
        try:
            while (item := self._next()) is not None:
                if item:
                    self._take(*item)
                if time.monotonic() - flushed > FLUSH_S:
                    flushed = time.monotonic()
                    self._bag.flush()
                    self._beside()
                    self._check_room()
        except PanopticError as error:
            self.fault = error
        except Exception as error:  # report a bug as a fault: otherwise the thread would end silently
            self.fault = ContractError(f"{self._path} cannot be written: {error!r}")

    def _next(self) -> tuple[Connection, int, bytes] | tuple[()] | None:
        try:
            return self._messages.get(timeout=FLUSH_S / 2)
        except queue.Empty:
            return ()

    def _take(self, connection: Connection, stamp_ns: int, data: bytes) -> None:
        with self._lock:
            self._waiting -= len(data)
        if self._split is not None:
            self._turn(stamp_ns)
        self._bag.write_described(connection, stamp_ns, data)
        self._size += len(data)
        self._part_size += len(data)
        self.counters.setdefault(connection.topic, TopicCounter(connection.kind)).add(data)

    def _turn(self, stamp_ns: int) -> None:
        """Close the bag and open the next part if the current one has reached its limit."""
        assert self._split is not None
        if self._part_begun_ns < 0:
            self._part_begun_ns = stamp_ns
        if not self._split.is_over(self._part_size, 1e-9 * (stamp_ns - self._part_begun_ns)):
            return
        self._bag.close()
        self._bag = self._next_bag()
        self._part_size, self._part_begun_ns = 0, stamp_ns
        for connection, data in self._opening():
            self._bag.write_described(connection, stamp_ns, data)

    def _next_bag(self) -> BagWriter:
        """Open the bag, or its next part.

        Raises:
            DataError: if its path exists already.
        """
        path = self._path
        if self._split is not None:
            if self._parts == 0:
                if os.path.lexists(path):
                    raise DataError(f"{path} exists already; give another --out, or move it away")
                with file_errors(path, "write"):
                    path.mkdir(parents=True)
            path = path / f"{self._parts:03d}"
        self._parts += 1
        return BagWriter(path, in_place=True)

    def _check_room(self) -> None:
        """Check the budget and the free disk space.

        Raises:
            DiskFull: if no more may be written.
        """
        if self._budget and self._size > self._budget:
            raise DiskFull(f"{self._bag.path} has reached its budget of {self._budget / GB:g} GB")
        free = shutil.disk_usage(self._bag.path).free
        if free < self._keep_free:
            raise DiskFull(f"only {free / 1e6:.0f} MB are free beside {self._bag.path}: free some space")


class DiskFull(EnvironmentProblem):
    """The disk or the budget has no space left; all data written before is complete."""
