"""Export of a recording as one HTML file with its images, for readers who only have a browser."""

from __future__ import annotations

import base64
import gzip
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import fields, replace
from typing import Any

import numpy as np

from panoptic_ros.domain import RefinedPoseSet, ViewDetections
from panoptic_ros.errors import UsageError
from panoptic_ros.io.messages import bag_messages, from_message, to_message
from panoptic_ros.io.messages.family import bag_typestore, decode_cdr
from panoptic_ros.stage import Progress, each, untold
from panoptic_ros.view.page.html import page
from panoptic_ros.view.page.packets import PacketKind, PageMessage, pack
from panoptic_ros.view.page.peek import detections_head, stamp_of_bytes
from panoptic_ros.view.page.recorded import BLOCK_NS, RecordedScene

LONGEST_S = 900  # s; longest recording in one file, as browsers have trouble with several hundred megabytes
BODIES = ("bodies",)  # topic keys of layers that are visible by default
LEFT_OUT = ("time_shift", "side_votes", "corrections")  # fields of skeletons that a page does not show


def one_file(
    scene: RecordedScene,
    begin_s: float = 0.0,
    end_s: float | None = None,
    progress: Progress = untold,
) -> bytes:
    """Return the HTML document of a part of a recording.

    It holds skeletons, bodies, previews, and the 2D poses of the shown images, without score maps.

    Args:
        scene: Recorded scene.
        begin_s, end_s: Time range from the beginning of the recording, extended to whole seconds. None is its
            end.
        progress: Callback for a progress bar.

    Raises:
        UsageError: If the range is empty, or longer than a browser can handle.
    """
    first, last = int(begin_s), scene.block_count if end_s is None else -int(-end_s // 1)
    numbers = range(max(0, first), min(scene.block_count, last))
    if not numbers:
        raise UsageError(
            f"there are no data from {begin_s:g} s to {last:g} s: the recording is {scene.block_count} s long"
        )
    if len(numbers) > LONGEST_S:
        raise UsageError(
            f"{len(numbers)} s are too much for one file, the limit is {LONGEST_S} s; choose a part by "
            "--from and --to, or share the page of `panoptic view --host 0.0.0.0`"
        )
    facts, blocks, seen = scene.facts(), [], Counter[str]()
    for done, number in enumerate(each(numbers, len(numbers), progress, "seconds")):
        there = scene.messages(number, BODIES)
        messages = list(_smaller(scene, facts["topics"], there, seen))
        packet = pack(PacketKind.BLOCK, done, messages)
        blocks.append(base64.b64encode(gzip.compress(packet, 6, mtime=0)).decode())
    begin_ns = int(facts["begin_ns"]) + numbers[0] * BLOCK_NS
    end_ns = min(int(facts["end_ns"]), begin_ns + len(numbers) * BLOCK_NS - 1)
    facts |= {
        "begin_ns": str(begin_ns),
        "end_ns": str(end_ns),
        "rates": {name: count / max(1e-9, (end_ns - begin_ns) * 1e-9) for name, count in seen.items()},
    }
    spans = _clipped(scene.presence.spans, numbers[0], numbers[-1] + 1)
    presence = {"type": "presence", "spans": spans, "complete": True}
    return page({"facts": facts, "presence": presence, "blocks": blocks})


def _smaller(
    scene: RecordedScene, topics: list[list[str]], messages: Iterable[PageMessage], seen: Counter[str]
) -> Iterator[PageMessage]:
    """Yield the messages without data that a page does not need, and count each camera's images in `seen`."""
    held = list(messages)
    keys = [tuple(topics[message.topic][:2]) for message in held]
    shown = {
        (owner, stamp_of_bytes(message.data)) for (key, owner), message in zip(keys, held) if key == "preview"
    }
    for (key, owner), message in zip(keys, held):
        if key == "detections":
            seen[owner] += 1
            if (owner, detections_head(message.data)[0]) in shown or not shown:
                yield PageMessage(message.topic, _rewritten(message.data, "ViewDetections", _without_maps))
        elif key == "skeletons":
            yield PageMessage(message.topic, _rewritten(message.data, "RefinedPoseSet", _bare))
        else:
            yield message


def _rewritten(data: bytes, record: str, change: Callable[[Any], Any]) -> bytes:
    kind = {"ViewDetections": "panoptic_msgs/msg/ViewDetections"}.get(record, "panoptic_msgs/msg/Skeletons")
    message = to_message(change(from_message(decode_cdr(data, kind), record)), bag_messages())
    return bytes(bag_typestore().serialize_cdr(message, kind))


def _without_maps(view: ViewDetections) -> ViewDetections:
    return replace(view, maps=None, limit=None)


def _bare(poses: RefinedPoseSet) -> RefinedPoseSet:
    return RefinedPoseSet(
        **{item.name: getattr(poses, item.name) for item in fields(poses) if item.name not in LEFT_OUT}
    )


def _clipped(spans: list[list[float]], begin: float, end: float) -> list[list[float]]:
    """Return the spans inside [begin, end) s, with times relative to `begin`."""
    inside = [[i, *np.clip([a, b], begin, end) - begin] for i, a, b in spans if a < end and b >= begin]
    return [[int(i), float(a), float(b)] for i, a, b in inside]
