"""A stream of a media file, packet by packet."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import av

from panoptic_ros.errors import DataError, one_line


def decoded(container: Any, stream: Any, what: str) -> Iterator[tuple[Any, list[Any] | None]]:
    """Yield each packet of a stream and its frames; None: it cannot be decoded, later ones may be good.

    Args:
        container, stream: of PyAV. what: the file, for the message.

    Raises:
        DataError: if the file cannot be read on, after all packets before.
    """
    packets = container.demux(stream)
    while True:
        try:
            packet = next(packets)
        except StopIteration:
            return
        except Exception as error:  # PyAV decodes the texts of a file, too
            raise DataError(f"{what} cannot be read on: {reason(error)}") from None
        try:
            frames = packet.decode()
        except av.FFmpegError:
            frames = None
        yield packet, frames
        del frames, packet


def reason(error: Exception) -> str:
    """A few words of FFmpeg."""
    return str(getattr(error, "strerror", None) or one_line(error))
