"""Read the structure of video files: completeness, hidden frames, edit lists and timecode rate.

Formats: ISO/IEC 14496-12 (boxes of MP4 and QuickTime), Microsoft RIFF (AVI), RFC 8794 (EBML of Matroska).
FFmpeg handles other containers.
"""

from __future__ import annotations

import math
import struct
from fractions import Fraction
from pathlib import Path
from typing import BinaryIO

from panoptic_ros.io.files import file_errors

_TOP_BOXES = {
    b"ftyp",
    b"moov",
    b"mdat",
    b"free",
    b"skip",
    b"wide",
    b"pnot",
    b"moof",
    b"sidx",
    b"uuid",
    b"styp",
}
_EBML, _SEGMENT = b"\x1a\x45\xdf\xa3", b"\x18\x53\x80\x67"
_HEAD = 4096  # bytes; the segment of a Matroska file begins within them
_BIG_BOX = 1 << 26  # bytes; a larger frame index is not searched


def find_cut(path: Path) -> str:
    """Describe the missing end of a file; "" if the file seems complete."""
    with file_errors(path, "read"), open(path, "rb") as file:
        size = path.stat().st_size
        head = file.read(12)
        if head[:4] == _EBML:
            wanted = _segment_end(head + file.read(_HEAD))
            return f"{size} bytes of {wanted}" if size < wanted else ""
        if head[:4] == b"RIFF" and head[8:12] == b"AVI ":
            wanted = struct.unpack("<I", head[4:8])[0] + 8
            return f"{size} bytes of {wanted}" if 8 < size < wanted else ""
        if head[4:8] not in _TOP_BOXES:
            return ""
        names = []
        for name, start, length in _boxes(file, size):
            names.append(name)
            if start + length > size:
                return f"{size} bytes of at least {start + length}"
        if b"moov" not in names:
            return "its index of frames (the moov box, which recorders write last) is missing"
        return ""


def hidden_seconds(path: Path) -> float:
    """Return the duration (s) of frames that the file counts but players never show; 0 for an AVI.

    The edit list of an MP4 hides the start of a trimmed copy. Encoders that reorder frames hide a delay of a
    few frames. The result is infinite if the container does not count single frames, or has several edits.
    """
    with file_errors(path, "read"), open(path, "rb") as file:
        head = file.read(12)
        if head[:4] == b"RIFF":
            return 0.0
        tracks = _tracks(file, path.stat().st_size)
    return max((_edited(track) for track in tracks if b"vide" in track), default=math.inf)


def has_edits(path: Path) -> bool:
    """Return whether an MP4 has an edit list for its video; its times then exclude the encoder's delay."""
    with file_errors(path, "read"), open(path, "rb") as file:
        return any(b"vide" in track and b"elst" in track for track in _tracks(file, path.stat().st_size))


def timecode_rate(path: Path) -> tuple[int, Fraction] | None:
    """Return labels per second and their true rate (Hz) of an MP4's timecode track; None if it has none.

    Source: QuickTime File Format, timecode sample description.
    """
    with file_errors(path, "read"), open(path, "rb") as file:
        tracks = _tracks(file, path.stat().st_size)
    for track in tracks:
        handler, entry = track.find(b"hdlr") + 12, track.find(b"tmcd", max(0, track.find(b"stsd")))
        if track[handler : handler + 4] != b"tmcd" or entry < 0 or entry + 29 > len(track):
            continue
        scale, duration, labels = struct.unpack_from(">IIB", track, entry + 20)
        if scale and duration and labels:
            return labels, Fraction(scale, duration)
    return None


def _tracks(file: BinaryIO, size: int) -> list[bytes]:
    """Return the tracks in the index of an MP4; empty for a fragmented MP4 or an index above 64 MB."""
    file.seek(0)
    if file.read(8)[4:] not in _TOP_BOXES:
        return []
    boxes = _boxes(file, size)
    index = [(start, length) for name, start, length in boxes if name == b"moov"]
    if not index or index[0][1] > _BIG_BOX or any(name == b"moof" for name, _, _ in boxes):
        return []
    file.seek(index[0][0])
    return file.read(index[0][1]).split(b"trak")[1:]


def _boxes(file: BinaryIO, size: int) -> list[tuple[bytes, int, int]]:
    """Return (name, start, length) of the outermost boxes; the last may extend beyond the end of the file."""
    found = []
    start = 0
    while start + 8 <= size:
        file.seek(start)
        length, name = struct.unpack(">I4s", file.read(8))
        if length == 1:
            length = int.from_bytes(file.read(8), "big")
        elif length == 0:
            length = size - start
        if length < 8:  # no box: trailing bytes that players ignore
            break
        found.append((name, start, length))
        start += length
    return found


def _segment_end(head: bytes) -> int:
    """Return the end of a Matroska file's segment, bytes; 0 if it is not stated, as in a stream."""
    length, at = _ebml_size(head, len(_EBML))
    segment = at + length
    if head[segment : segment + len(_SEGMENT)] != _SEGMENT:
        return 0
    length, at = _ebml_size(head, segment + len(_SEGMENT))
    return at + length if length else 0


def _ebml_size(head: bytes, at: int) -> tuple[int, int]:
    """Return the size of an element (0 = unknown) and the start of its content."""
    first = head[at] if at < len(head) else 0
    width = 9 - first.bit_length()
    value = int.from_bytes(head[at : at + width], "big") & ((1 << 7 * width) - 1)
    return (0 if not first or value == (1 << 7 * width) - 1 else value), at + width


def _edited(track: bytes) -> float:
    """Return the seconds at the start of a track that its edit list hides; see `hidden_seconds`."""
    at, scale_at = track.find(b"elst"), track.find(b"mdhd")
    if at < 0:
        return 0.0
    count = int.from_bytes(track[at + 8 : at + 12], "big")
    layout, width = (">QqI", 20) if track[at + 4] == 1 else (">IiI", 12)
    if scale_at < 0 or at + 12 + count * width > len(track):
        return math.inf
    entries = [struct.unpack_from(layout, track, at + 12 + i * width) for i in range(count)]
    starts = [entry[1] for entry in entries if entry[1] >= 0]  # -1 = an empty edit before the first image
    scale_at += 24 if track[scale_at + 4] == 1 else 16
    scale = int.from_bytes(track[scale_at : scale_at + 4], "big")
    return starts[0] / scale if len(starts) == 1 and scale else math.inf
