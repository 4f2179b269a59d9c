"""Decode a stream of a media file packet by packet."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import av

from panoptic_ros.errors import DataError, one_line


def decoded(container: Any, stream: Any, what: str) -> Iterator[tuple[Any, list[Any] | None]]:
    """Yield each packet of a stream with its frames, or None if it cannot be decoded.

    Packets after an undecodable one may be good.

    Args:
        container, stream: objects of PyAV.
        what: subject of the error message.

    Raises:
        DataError: if the rest of the file cannot be read, after all packets before.
    """
    packets = container.demux(stream)
    while True:
        try:
            packet = next(packets)
        except StopIteration:
            return
        except Exception as error:  # PyAV also decodes the texts in a file, which can raise other errors
            raise DataError(f"{what} cannot be read further: {reason(error)}") from None
        try:
            frames = packet.decode()
        except av.FFmpegError:
            frames = None
        yield packet, frames
        del frames, packet


def reason(error: Exception) -> str:
    """Return FFmpeg's short description of an error."""
    return str(getattr(error, "strerror", None) or one_line(error))
