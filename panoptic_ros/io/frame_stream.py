"""Write a JSON document frame by frame, so that memory does not grow with the duration.

If the writer is killed, the document ends early. `read_frames` then reads its complete frames.
"""

from __future__ import annotations

import json
import os
import threading
import warnings
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from panoptic_ros.errors import DataError
from panoptic_ros.io.files import file_errors, read_bytes, read_json

GZIP = 31  # `wbits` of zlib for a gzip file
END = "]}\n"
# Limit of unpacked bytes / packed bytes. Our files have 3 to 8.
MOST_TIMES = 100


class FrameStream:
    """Writer of a document {..., "frames": [...]}.

    Args:
        head: keys and values before "frames".
        packed: gzip the document.
        named: path that errors name, if `path` is temporary.

    Raises:
        EnvironmentProblem: if the file cannot be written.
    """

    def __init__(self, path: Path, head: Mapping[str, Any], packed: bool = True, named: Path | None = None):
        self._path = named or path
        self._packer: Any = zlib.compressobj(9, zlib.DEFLATED, GZIP) if packed else _Unpacked()
        self._lock = threading.Lock()  # `sync` runs in the recorder thread
        self._unsynced = True
        self.count = 0
        with file_errors(self._path, "write"):
            self._file = path.open("wb")
        self._write(json.dumps({**head, "frames": []}).removesuffix("]}"))

    def add(self, frame: Mapping[str, Any]) -> None:
        """Append a frame."""
        self._write((", " if self.count else "") + json.dumps(frame, allow_nan=False))
        self.count += 1

    def sync(self) -> None:
        """Write all frames so far to the disk: a power cut then loses only later frames. Thread-safe.

        The time of the call changes the bytes of the file but not its content.
        """
        with file_errors(self._path, "write"):
            with self._lock:
                if not self._unsynced or self._file.closed:
                    return
                self._unsynced = False
                self._file.write(self._packer.flush(zlib.Z_SYNC_FLUSH))
                self._file.flush()
                descriptor = os.dup(self._file.fileno())
            try:  # outside of the lock, because fsync can take long
                os.fsync(descriptor)
            finally:
                os.close(descriptor)

    def close(self) -> None:
        """Finish the file."""
        self._write(END)
        with file_errors(self._path, "write"), self._lock:
            self._file.write(self._packer.flush())
            self._file.flush()
            os.fsync(self._file.fileno())
            self._file.close()

    def discard(self) -> None:
        """Close the file without finishing it."""
        self._file.close()

    def _write(self, text: str) -> None:
        with self._lock:
            data = self._packer.compress(text.encode())
            self._unsynced = True
            with file_errors(self._path, "write"):
                self._file.write(data)


class _Unpacked:
    """Stand-in for a compressor that leaves the bytes as they are."""

    def compress(self, data: bytes) -> bytes:
        """Return the bytes."""
        return data

    def flush(self, mode: int = zlib.Z_FINISH) -> bytes:
        """Return nothing: no bytes are held."""
        return b""


class CutFileWarning(UserWarning):
    """A file ends early; its complete frames were read."""


def read_frames(path: Path) -> Any:
    """Read a JSON document of frames; if it ends early, return its complete frames with a `CutFileWarning`.

    Raises:
        DataError: if it is not such a document.
    """
    try:
        return read_json(path)
    except DataError:
        found = whole_frames(read_bytes(path))
        if found is None:
            raise
    document, lost = found
    count = len(document["frames"])
    text = f"{path} ends early: its {count} whole frames were read, the last {lost} characters are lost"
    warnings.warn(text, CutFileWarning, stacklevel=3)
    return document


def whole_frames(packed: bytes) -> tuple[dict[str, Any], int] | None:
    """Return a cut document with its complete frames, and the number of characters lost.

    Args:
        packed: bytes of the gzipped file.

    Returns:
        None if the data are not such a document, or damaged in another way than a missing end.
    """
    text = _cut_text(packed)
    # After a power cut a file may have its full length, but zeros where the last bytes were not written.
    text = _cut_text(packed.rstrip(b"\0")) if text is None else text
    begin = -1 if text is None else text.find('"frames": [')
    if text is None or begin < 0:
        return None
    at = begin + len('"frames": [')
    try:
        document: dict[str, Any] = json.loads(text[:at] + END)
    except (ValueError, RecursionError):
        return None
    decoder, end = json.JSONDecoder(), at
    while text.startswith("{", at):
        try:
            frame, end = decoder.raw_decode(text, at)
        except (ValueError, RecursionError):
            break
        document["frames"].append(frame)
        at = end + len(", ")
    return document, len(text) - end


def _cut_text(packed: bytes) -> str | None:
    """Return the readable text of a gzip file that ends early; "" if it is complete, None if damaged."""
    unpacker = zlib.decompressobj(GZIP)
    try:
        if zlib.decompressobj(GZIP).decompress(packed, 1) != b"{":  # first check one byte
            return None
        text = unpacker.decompress(packed, MOST_TIMES * len(packed)).decode(errors="ignore")
    except zlib.error:
        return None
    return "" if unpacker.eof else text
