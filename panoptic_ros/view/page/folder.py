"""Scene of a capture folder: its raw images, and the ground truth if available."""

from __future__ import annotations

import heapq
import tempfile
import threading
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any

from panoptic_ros.capture import CaptureFolder
from panoptic_ros.domain import SkeletonModel, ViewFrame
from panoptic_ros.errors import DataError, UserError
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.loading import file_errors
from panoptic_ros.io.messages import bag_messages, to_message
from panoptic_ros.io.messages.family import bag_typestore
from panoptic_ros.io.previews import Previews
from panoptic_ros.view.page.facts import PageTopic, SceneFacts
from panoptic_ros.view.page.packets import PacketKind, PageMessage, pack
from panoptic_ros.view.page.presence import PresenceSpans
from panoptic_ros.view.page.recorded import BLOCK_NS
from panoptic_ros.view.page.truth import KEY, MESSAGE, TruthSkeletons

MOST_KEPT = 4 * 10**9  # bytes of previews in the temporary file, enough for half an hour of 31 VGA cameras


class FolderScene:
    """Scene of videos and image folders, read once from the beginning.

    A page waits for seconds that are not read yet.
    Reading stops with an error when the previews fill `most` bytes or the disk.

    Args:
        folder: Capture folder. The scene closes it.
        title: Title for the reader.
        skeleton: Skeleton of the ground truth.
        truth: Ground truth, if available.
        most: Size limit of the preview file in bytes.

    Raises:
        DataError: If a source has no images.
    """

    kind = "recorded"
    is_read_by_scan = True  # true because seconds become available only as `scan` reads them

    def __init__(
        self,
        folder: CaptureFolder,
        title: str,
        skeleton: SkeletonModel,
        truth: TruthSkeletons | None = None,
        most: int = MOST_KEPT,
    ):
        self._folder, self._truth, self._most = folder, truth, most
        first = [next(iter(source), None) for source in folder.sources]
        if None in first:
            raise DataError(f"{folder.path}: a camera has no images")
        self._begin_ns = min(frame.stamp_ns for frame in first if frame is not None)
        length_s = max((source.frame_count or 0) / source.frame_rate for source in folder.sources)
        self.block_count = max(1, int(length_s) + 1)
        message = TOPICS["preview"].message
        topics = [PageTopic("preview", name, message) for name in folder.rig.names]
        if truth is not None:
            topics.append(PageTopic(KEY, "", MESSAGE))
        self._facts = SceneFacts(
            "recorded",
            title,
            folder.rig,
            skeleton,
            topics,
            self._begin_ns,
            self._begin_ns + round(length_s * 1e9),
            rates={source.camera: source.frame_rate for source in folder.sources},
        )
        self._kept = tempfile.TemporaryFile(prefix="panoptic-view-")
        self._places: dict[int, list[tuple[int, int, int]]] = {}  # by block: list of (topic, offset, length)
        self._lock = threading.Lock()
        self._read = 0  # number of complete blocks
        self._fault: UserError | None = None
        self.presence = PresenceSpans()

    def facts(self) -> dict[str, Any]:
        """Return the first document that a page receives."""
        return self._facts.document()

    def has(self, number: int) -> bool:
        """Return whether a second has been read, or never will be because reading failed."""
        return self._read > number or self._fault is not None

    def block(self, number: int, keys: Collection[str] = ()) -> bytes:
        """Return the packet of one second.

        Raises:
            UserError: If the second has not been read yet, or cannot be.
        """
        return pack(PacketKind.BLOCK, number, self.messages(number, keys))

    def messages(self, number: int, keys: Collection[str] = ()) -> Iterator[PageMessage]:
        """Yield the messages of `block` one by one."""
        with self._lock:
            if self._read <= number:
                later = DataError(f"{self._folder.path}: second {number} is not read yet; ask again later")
                raise self._fault or later
            for topic, offset, length in self._places.get(number, ()):
                self._kept.seek(offset)
                yield PageMessage(topic, self._kept.read(length))
        if self._truth is not None and KEY in keys:
            begin = self._begin_ns + number * BLOCK_NS
            for data in self._truth.between(begin, begin + BLOCK_NS):
                yield PageMessage(len(self._facts.topics) - 1, data)

    def scan(self, stopped: Callable[[], bool], told: Callable[[], None]) -> None:
        """Read all images; meant for a separate thread. See `RecordedScene.scan`."""
        for stamp, ids in self._truth.people() if self._truth is not None else ():
            self.presence.saw((stamp - self._begin_ns) * 1e-9, ids)
        told()
        previews, places = Previews(), {name: k for k, name in enumerate(self._folder.rig.names)}
        try:
            for frame in heapq.merge(*self._folder.sources, key=lambda frame: frame.stamp_ns):
                if stopped():
                    return
                preview = previews.take(frame)
                if preview is not None:
                    message = to_message(preview, bag_messages())
                    data = bytes(bag_typestore().serialize_cdr(message, message.__msgtype__))
                    self._keep(frame, places[frame.camera], data)
        except UserError as error:
            self._fault = error
            return
        self._read = 2**31
        self.presence.complete = True
        told()

    def close(self) -> None:
        """Close all files."""
        self._folder.close()
        self._kept.close()

    def _keep(self, frame: ViewFrame, topic: int, data: bytes) -> None:
        number = (frame.stamp_ns - self._begin_ns) // BLOCK_NS
        with self._lock, file_errors(Path(tempfile.gettempdir()), "keep previews in"):
            offset = self._kept.seek(0, 2)
            if offset + len(data) > self._most:
                raise DataError(
                    f"{self._folder.path}: previews of {number} s fill the {self._most / 1e9:g} GB that are "
                    "kept; use `panoptic run` and view its results"
                )
            self._kept.write(data)
            self._places.setdefault(number, []).append((topic, offset, len(data)))
            self._read = max(self._read, number)
