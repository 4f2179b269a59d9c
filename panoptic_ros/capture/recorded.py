"""The cameras of a recording, opened together: frames of each, and depth maps where there are any."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from itertools import tee
from typing import Any

from panoptic_ros.capture.at_once import opened_at_once
from panoptic_ros.capture.depth_folder import DepthSource
from panoptic_ros.capture.described import open_source
from panoptic_ros.capture.source import FrameSource
from panoptic_ros.domain import Rig, ViewFrame
from panoptic_ros.stage import Notice

Note = Callable[[Notice], None]


def open_recording(
    rig: Rig, descriptions: Mapping[str, Mapping[str, Any]], stack: ExitStack, note: Note
) -> dict[tuple[str, str], Iterator[Any]]:
    """Iterators of `ViewFrame`s by ("image", camera), and of `DepthFrame`s by ("depth", camera).

    Args:
        descriptions: by camera, see `open_source`.
        stack: closes the files.
        note: takes what is known after the last frame of a camera.

    Raises:
        UserError: as `open_source`.
    """
    records: dict[tuple[str, str], Iterator[Any]] = {}
    sources = opened_at_once(lambda camera: open_source(camera, rig, descriptions[camera])[0], descriptions)
    for camera, source in zip(descriptions, sources):
        stack.enter_context(source)
        frames, again = tee(_noted(source, note))
        records["image", camera] = frames
        if isinstance(source, DepthSource):
            records["depth", camera] = map(source.depth_of, again)
    return records


def _noted(source: FrameSource, note: Note) -> Iterator[ViewFrame]:
    """Yield the frames of a source; after the last one, pass on its notices."""
    yield from source
    for notice in getattr(source, "after", ()):  # live sources have no last frame
        note(notice)
