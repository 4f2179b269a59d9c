"""Scene of a bag, read one second at a time when a page requests it."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

from panoptic_ros.domain import Rig, SkeletonModel
from panoptic_ros.errors import DataError
from panoptic_ros.graph.topics import ALWAYS_SHOWN, ASKED_FOR, TOPICS
from panoptic_ros.io.bags import BagReader
from panoptic_ros.io.messages import bag_messages, frame_from_message, from_message, to_message
from panoptic_ros.io.messages.family import bag_typestore, decode_cdr
from panoptic_ros.io.plain_formats import PlainSkeletons
from panoptic_ros.io.previews import Previews
from panoptic_ros.view.page.facts import PageTopic, SceneFacts
from panoptic_ros.view.page.packets import PacketKind, PageMessage, pack
from panoptic_ros.view.page.peek import skeletons_head
from panoptic_ros.view.page.presence import PresenceSpans, ids_of
from panoptic_ros.view.page.truth import KEY, MESSAGE, TruthSkeletons

BLOCK_NS = 1_000_000_000
# s; polling interval of the paused scan, and pause after each block so that the page can draw it
GIVE_WAY_S, QUIET_S = 0.002, 0.5
IMAGES = ("compressed_image", "image")  # image topics to make previews from if a camera has no preview topic


class RecordedScene:
    """Scene of a bag. The rig and skeleton come from the bag or from the arguments.

    Args:
        bag: Path of the bag.
        title: Title for the reader.
        rig, skeleton: Replacement for those of the bag.
        report: See `SceneFacts`.
        truth: Ground truth skeletons.

    Raises:
        DataError: If the bag cannot be read, or lacks a rig or skeleton that is not given.
    """

    kind = "recorded"
    is_read_by_scan = False

    def __init__(
        self,
        bag: Path,
        title: str,
        rig: Rig | None = None,
        skeleton: SkeletonModel | None = None,
        report: Mapping[str, Any] = {},
        truth: PlainSkeletons | None = None,
    ):
        self._path = Path(bag)
        self._bag = BagReader(self._path)
        self._lock = threading.Lock()  # all pages share one open file
        self._asked = 0  # number of blocks being read for pages
        self._quiet_until = 0.0  # s of the monotonic clock; the scan pauses until then so that pages can draw
        self._names: dict[str, PageTopic] = {}  # by the name in the bag
        self._sources: dict[int, tuple[str, PageTopic]] = {}  # by the topic number on the page
        self.rig = rig if rig is not None else self._latched("rig", "the bag lacks /rig: give --rig")
        self.skeleton = skeleton or self._latched("skeleton_model", "the bag lacks /skeleton_model")
        self._choose_topics()
        topics = [topic for _, topic in self._sources.values()]
        self._truth = None if truth is None else TruthSkeletons(truth, self.skeleton)
        if truth is not None:
            topics.append(PageTopic(KEY, "", MESSAGE))
        self._facts = SceneFacts(
            "recorded",
            title,
            self.rig,
            self.skeleton,
            topics,
            self._bag.begin_ns,
            self._bag.end_ns,
            report,
        )
        self.presence = PresenceSpans()

    @property
    def block_count(self) -> int:
        """Return the length of the recording in seconds, rounded up."""
        return max(1, math.ceil((self._bag.end_ns - self._bag.begin_ns + 1) / BLOCK_NS))

    @property
    def has_people(self) -> bool:
        """Return whether there are messages with skeletons or bodies."""
        names = [name for name, topic in self._sources.values() if topic.key in ("skeletons", "bodies")]
        return any(self._bag.counts[name] for name in names)

    def facts(self) -> dict[str, Any]:
        """Return the first document that a page receives."""
        return self._facts.document()

    def block(self, number: int, keys: Collection[str] = ()) -> bytes:
        """Return a packet of one second: all messages of the topics that are always shown and of `keys`.

        Raises:
            DataError: If the bag is damaged there.
        """
        self._asked += 1
        try:
            return pack(PacketKind.BLOCK, number, self.messages(number, keys))
        finally:
            self._quiet_until = time.monotonic() + QUIET_S
            self._asked -= 1

    def has(self, number: int) -> bool:
        """Return True, because every second of a bag is available."""
        return True

    def messages(self, number: int, keys: Collection[str] = ()) -> Iterator[PageMessage]:
        """Yield the messages of `block` one by one."""
        begin = self._bag.begin_ns + number * BLOCK_NS
        wanted = {*ALWAYS_SHOWN, *keys}
        if self._truth is not None and KEY in keys:
            for data in self._truth.between(begin, begin + BLOCK_NS):
                yield PageMessage(len(self._sources), data)
        chosen = {name: place for place, (name, topic) in self._sources.items() if topic.key in wanted}
        if not chosen:
            return
        previews = Previews()
        with self._lock:
            found = list(self._bag.raw(*chosen, begin_ns=begin, end_ns=begin + BLOCK_NS))
        for name, _, data, kind in found:
            topic = self._sources[chosen[name]][1]
            if name in self._made:
                small = self._preview(topic.owner, bytes(data), kind, previews)
                if small is not None:
                    yield PageMessage(chosen[name], small)
            else:
                yield PageMessage(chosen[name], bytes(data))

    def scan(self, stopped: Callable[[], bool], told: Callable[[], None]) -> None:
        """Read all skeletons to find the presence of each id; meant for a separate thread.

        Args:
            stopped: Callback that returns True to abort the scan.
            told: Callback after each batch of updates to `presence`.
        """
        names = [name for name, topic in self._sources.values() if topic.key == "skeletons"]
        with BagReader(self._path) as bag:
            for count, (_, _, data, _) in enumerate(bag.raw(*names) if names else ()):
                while (self._asked or time.monotonic() < self._quiet_until) and not stopped():
                    time.sleep(GIVE_WAY_S)
                if stopped():
                    return
                stamp = skeletons_head(data).stamp_ns
                self.presence.saw((stamp - self._bag.begin_ns) * 1e-9, ids_of(bytes(data)))
                if count % 2000 == 1999:
                    told()
        self.presence.complete = True
        told()

    def close(self) -> None:
        """Close the bag."""
        self._bag.close()

    def _latched(self, key: str, missing: str) -> Any:
        name = self._named(key, "")
        if name is None:
            raise DataError(f"{self._path}: {missing}")
        for _, _, message in self._bag.messages(name):
            return from_message(message, TOPICS[key].record)
        raise DataError(f"{self._path}: {missing}")

    def _named(self, key: str, owner: str) -> str | None:
        """Return the bag's name of a topic, in any namespace, or None."""
        topic = TOPICS[key]
        usual = "/" + topic.of(owner)
        for name, kind in self._bag.topics.items():
            if kind == topic.message and (name == usual or name.endswith(usual)):
                return name
        return None

    def _choose_topics(self) -> None:
        self._made: set[str] = set()
        for key in (*ALWAYS_SHOWN, *ASKED_FOR):
            owners = self.rig.names if TOPICS[key].scope == "camera" else ("",)
            for owner in owners:
                name = self._named(key, owner)
                if name is None and key == "preview":
                    name = next(filter(None, (self._named(image, owner) for image in IMAGES)), None)
                    self._made |= {name} if name is not None else set()
                if name is not None:
                    self._sources[len(self._sources)] = name, PageTopic(key, owner, TOPICS[key].message)

    def _preview(self, camera: str, data: bytes, kind: str, previews: Previews) -> bytes | None:
        """Return the CDR bytes of an image's preview, or None if none is due or decoding fails."""
        try:
            preview = previews.take(frame_from_message(decode_cdr(data, kind), camera, 0))
        except DataError:
            return None
        if preview is None:
            return None
        message = to_message(preview, bag_messages())
        return bytes(bag_typestore().serialize_cdr(message, message.__msgtype__))
