"""A capture folder as a scene: its images, before anything is made of them, and the truth if it is known."""

from __future__ import annotations

import heapq
import tempfile
import threading
from collections.abc import Callable, Collection, Iterator
from typing import Any

from panoptic_ros.capture import CaptureFolder
from panoptic_ros.domain import SkeletonModel, ViewFrame
from panoptic_ros.errors import DataError
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.messages import bag_messages, to_message
from panoptic_ros.io.messages.family import bag_typestore
from panoptic_ros.io.previews import Previews
from panoptic_ros.view.page.facts import PageTopic, SceneFacts
from panoptic_ros.view.page.packets import Kind, Message, pack
from panoptic_ros.view.page.presence import Presence
from panoptic_ros.view.page.recorded import BLOCK_NS
from panoptic_ros.view.page.truth import KEY, MESSAGE, Truth

PATIENCE_S = 120.0  # for a second of the recording to be read


class FolderScene:
    """Videos and folders of images, read once from their beginning; a page waits for what is not read yet.

    Args:
        folder: is closed with the scene. title: for people.
        skeleton: of the truth.

    Raises:
        DataError: if a source has no images.
    """

    kind = "recorded"
    is_read_by_scan = True  # whether there are no seconds before

    def __init__(
        self, folder: CaptureFolder, title: str, skeleton: SkeletonModel, truth: Truth | None = None
    ):
        self._folder, self._truth = folder, truth
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
        self._places: dict[int, list[tuple[int, int, int]]] = {}  # by block: topic, offset, length
        self._changed = threading.Condition()
        self._read = 0  # blocks that are whole
        self._fault: DataError | None = None
        self.presence = Presence()

    def facts(self) -> dict[str, Any]:
        """What a page is told first."""
        return self._facts.document()

    def block(self, number: int, keys: Collection[str] = ()) -> bytes:
        """A packet of one second, once it has been read.

        Raises:
            DataError: if the images cannot be read so far, or not in time.
        """
        return pack(Kind.BLOCK, number, self.messages(number, keys))

    def messages(self, number: int, keys: Collection[str] = ()) -> Iterator[Message]:
        """As `block`, one by one."""
        with self._changed:
            if not self._changed.wait_for(lambda: self._read > number or self._fault, PATIENCE_S):
                raise DataError(f"{self._folder.path}: second {number} is not read yet; ask again later")
            if self._read <= number and self._fault is not None:
                raise self._fault
            for topic, offset, length in self._places.get(number, ()):
                self._kept.seek(offset)
                yield Message(topic, self._kept.read(length))
        if self._truth is not None and KEY in keys:
            begin = self._begin_ns + number * BLOCK_NS
            for data in self._truth.between(begin, begin + BLOCK_NS):
                yield Message(len(self._facts.topics) - 1, data)

    def scan(self, stopped: Callable[[], bool], told: Callable[[], None]) -> None:
        """Read all images; meant for a thread of its own. See `RecordedScene.scan`."""
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
        except DataError as error:
            with self._changed:
                self._fault = error
                self._changed.notify_all()
            return
        with self._changed:
            self._read = 2**31
            self._changed.notify_all()
        self.presence.complete = True
        told()

    def close(self) -> None:
        """Close all files."""
        self._folder.close()
        self._kept.close()

    def _keep(self, frame: ViewFrame, topic: int, data: bytes) -> None:
        number = (frame.stamp_ns - self._begin_ns) // BLOCK_NS
        with self._changed:
            offset = self._kept.seek(0, 2)
            self._kept.write(data)
            self._places.setdefault(number, []).append((topic, offset, len(data)))
            if number > self._read:
                self._read = number
                self._changed.notify_all()
