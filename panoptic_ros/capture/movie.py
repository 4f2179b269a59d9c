"""Decode video files through PyAV (FFmpeg): frames and their presentation times."""

from __future__ import annotations

import heapq
import re
from collections.abc import Iterator
from fractions import Fraction
from itertools import islice
from pathlib import Path
from typing import Any

import av
from av.codec.hwaccel import HWAccel, hwdevices_available
from av.container import InputContainer
from av.packet import Packet
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from panoptic_ros.capture.packets import decoded, reason
from panoptic_ros.errors import DataError, EnvironmentProblem, UserError
from panoptic_ros.io.loading import check_file

# Matroska rounds times to 1 ms; a copy of such a file in another container keeps the rounded times.
MILLISECOND = Fraction(1, 1000)
_NO_TIMES = 0x0080  # flag AVFMT_NOTIMESTAMPS of libavformat
_NO_ZERO = 0x0200  # flag AVFMT_TS_DISCONT: times begin at any value, as in MPEG-TS
_IN_ORDER_OF_DECODING = {"avi"}  # formats whose times follow the storage order, not the presentation order
_REORDERED = 64  # packets that are searched for reordering; codecs allow 16 frames


class Movie:
    """Open video file, which is read once from its beginning.

    Args:
        what: subject of error messages.
        threads: decode several frames in parallel; not worth it for the first frame alone.
        hardware: FFmpeg's name of the decoding hardware (cuda, qsv, ...); "" = the CPU.
        skip_damaged: skip damaged frames: those that decoders conceal, and those predicted from them.

    Raises:
        DataError: if it cannot be opened, or has no video track, or the codec is unknown.
        EnvironmentProblem: if the hardware is missing or does not support this video.
    """

    def __init__(
        self, path: Path, what: str, *, threads: bool = True, hardware: str = "", skip_damaged: bool = False
    ):
        self._what = what
        self._container = open_media(path, what, hardware)
        self._by_storage = self._container.format.name in _IN_ORDER_OF_DECODING
        self.lost = 0  # frames that could not be decoded, after the first decoded one
        self.patched = 0  # frames with parts that could not be decoded
        self._damage = Damage() if skip_damaged else None
        try:
            self._stream = self._choose()
            if threads and not hardware:
                # slice threads report an error with its own packet
                self._stream.thread_type = "SLICE" if skip_damaged else "AUTO"
            else:
                self._stream.thread_count = 1
        except BaseException:
            self.close()
            raise

    def _choose(self) -> VideoStream:
        stream = self._container.streams.best("video")
        if not isinstance(stream, VideoStream):
            kinds = ", ".join(other.type for other in self._container.streams) or "nothing"
            raise DataError(f"{self._what} cannot be opened as video: it has no video track ({kinds} only)")
        if stream.codec_context is None:
            raise DataError(f"{self._what} cannot be opened: FFmpeg has no decoder for its codec; convert it")
        return stream

    @property
    def has_times(self) -> bool:
        """Return whether the format stores presentation times; raw streams do not."""
        return not self._container.format.flags & _NO_TIMES

    @property
    def has_zero(self) -> bool:
        """Return whether times of this format count from the beginning of the recording."""
        return self.has_times and not self._container.format.flags & _NO_ZERO

    @property
    def frame_rate(self) -> float:
        """Return the frame rate in Hz that the file states; 0 if it states none."""
        return float(self._stream.guessed_rate or 0)

    @property
    def tick(self) -> Fraction:
        """Return the rounding step of times in the file, s."""
        return self._stream.time_base or Fraction(0)

    def frame_count(self, begin: Fraction) -> int | None:
        """Return the number of frames that the file states, or its duration times its rate; None if neither.

        Args:
            begin: presentation time of the first frame, s.
        """
        if self._stream.frames > 0:
            return int(self._stream.frames)
        return int(self._duration(begin) * Fraction(self.frame_rate) + Fraction(1, 2)) or None

    def _duration(self, begin: Fraction) -> Fraction:
        """Return the duration of the images that the file states, s; 0 = none."""
        told = re.fullmatch(r"(\d+):(\d\d):(\d\d(?:\.\d+)?)", self._stream.metadata.get("DURATION", ""))
        if told:  # Matroska: FFmpeg takes the duration of the whole file for the duration of a track
            hours, minutes, seconds = (Fraction(part) for part in told.groups())
            end = 3600 * hours + 60 * minutes + seconds
        elif self._stream.duration:
            return Fraction(self._stream.duration * self.tick)
        else:
            end = Fraction(self._container.duration or 0, av.time_base)
        return max(Fraction(0), end - begin) if self.has_zero else end  # otherwise it is FFmpeg's estimate

    @property
    def tells_end(self) -> bool:
        """Return whether the file states the end of its last image, or the number of images."""
        return self._stream.frames > 0 or "DURATION" in self._stream.metadata

    @property
    def timecode(self) -> str:
        """Return the timecode HH:MM:SS:FF of the first frame, from a timecode track or a tag; "" = none."""
        tracks = [self._stream.metadata, *(track.metadata for track in self._container.streams.data)]
        for metadata in (*tracks, self._container.metadata):
            for key, value in metadata.items():
                if key.casefold() == "timecode":
                    return str(value).strip()
        return ""

    @property
    def sound_end(self) -> Fraction:
        """Return the end of the last audio packet, s; 0 = no audio. Reads the whole file."""
        end, tracks = Fraction(0), self._container.streams.audio
        for packet in self._container.demux(*tracks) if tracks else ():
            if packet.pts is not None and packet.time_base is not None:
                end = max(end, (packet.pts + (packet.duration or 0)) * packet.time_base)
        return end

    def frames(self) -> Iterator[VideoFrame]:
        """Yield frames in presentation order with times; skip packets that cannot be decoded.

        Raises:
            DataError: if the rest of the file cannot be read, after all frames before.
        """
        times: list[int] = []  # heap of packet times whose frames have not been yielded yet
        begun = False
        for packet, images in decoded(self._container, self._stream, self._what):
            if images is None:
                self.lost += begun and packet.size > 0
                if self._damage is not None:
                    self._damage.lost(self._time_of(packet))
            elif self._by_storage and packet.size and packet.dts is not None:
                heapq.heappush(times, packet.dts)
            begun = begun or bool(images)
            while images:  # keep no reference, so that frame memory is reused
                frame = images.pop(0)
                if isinstance(frame, VideoFrame):
                    if self._by_storage:
                        frame.pts = heapq.heappop(times) if times else None
                    self.patched += frame.is_corrupt
                    if self._damage is None or self._damage.spares(frame):
                        yield frame
                del frame

    @property
    def sound_tracks(self) -> list[bool]:
        """Return for each sound track whether it can be decoded."""
        return [track.codec_context is not None for track in self._container.streams.audio]

    @property
    def left_out(self) -> int:
        """Return the number of decoded frames that were skipped because of damage."""
        return 0 if self._damage is None else self._damage.left_out

    def frame_times(self) -> list[Fraction]:
        """Return the sorted presentation times of all frames, s, from the packets without decoding.

        Raises:
            DataError: if the rest of the file cannot be read.
        """
        return [ticks * self.tick for ticks in sorted(self._shown())]

    def reordering(self) -> int:
        """Return the largest delay of a frame in storage order, in frames; reads the first packets."""
        stored = list(islice(self._shown(), _REORDERED))
        place = {ticks: k for k, ticks in enumerate(sorted(stored))}
        return max((k - place[ticks] for k, ticks in enumerate(stored)), default=0)

    def _shown(self) -> Iterator[int]:
        """Yield the presentation times of the packets in storage order, ticks."""
        try:
            for packet in self._container.demux(self._stream):
                time = self._time_of(packet)
                if packet.size and not packet.is_discard and time is not None:
                    yield time
        except (av.FFmpegError, OSError) as error:
            raise DataError(f"{self._what} cannot be read further: {reason(error)}") from None

    def _time_of(self, packet: Packet[Any]) -> int | None:
        """Return the presentation time of a packet's frame, else its decoding time, ticks."""
        return packet.dts if packet.pts is None or self._by_storage else packet.pts

    def close(self) -> None:
        """Close the file; may be called twice."""
        self._container.close()


class Damage:
    """Damaged ranges of a video: from a lost or concealed frame to the next key frame."""

    def __init__(self) -> None:
        self.left_out = 0
        self._begin: int | None = None  # first tick of a damaged range
        self._last = 0  # last tick in it that is known to be damaged

    def lost(self, time: int | None) -> None:
        """Record a frame that could not be decoded."""
        if time is not None:
            self._last = time if self._begin is None else max(self._last, time)
            self._begin = time if self._begin is None else min(self._begin, time)

    def spares(self, frame: VideoFrame) -> bool:
        """Return whether a frame is intact; frames must come in presentation order."""
        time = frame.dts if frame.pts is None else frame.pts
        if frame.is_corrupt:
            self.lost(time)
        if self._begin is not None and time is not None and time > self._last and frame.key_frame:
            self._begin = None
        good = not frame.is_corrupt and (self._begin is None or (time is not None and time < self._begin))
        self.left_out += not good
        return good


def shown_at(frame: VideoFrame) -> Fraction | None:
    """Return the presentation time of a frame, s; None if the file does not state it."""
    ticks = frame.dts if frame.pts is None else frame.pts
    return None if ticks is None or frame.time_base is None else ticks * frame.time_base


def rounding(time: Fraction, tick: Fraction) -> Fraction:
    """Return the largest rounding error of a time difference in a file, s.

    Args:
        tick: rounding step that the file states, s.
    """
    return max(tick, MILLISECOND) if time % MILLISECOND == 0 else tick


def open_media(path: Path, what: str, hardware: str = "") -> InputContainer:
    """Open a file for reading.

    Args:
        hardware: decoding hardware, see `Movie`; there is no fallback to software.

    Raises:
        DataError: if the file cannot be opened.
        EnvironmentProblem: if the hardware cannot decode it.
    """
    try:
        check_file(path)
        container = av.open(str(path))
    except UserError:
        raise
    except Exception as error:  # PyAV also decodes the texts in a file, which can raise other errors
        raise DataError(f"{what} cannot be opened: no video, or damaged ({reason(error)})") from None
    if not hardware:
        return container
    container.close()
    known = hwdevices_available()
    if hardware not in known:
        raise EnvironmentProblem(
            f"FFmpeg does not support {hardware} here; there are {', '.join(known) or 'none'}"
        )
    try:
        return av.open(str(path), hwaccel=HWAccel(device_type=hardware, allow_software_fallback=False))
    except (av.FFmpegError, OSError, RuntimeError) as error:
        raise EnvironmentProblem(
            f"{what}: {hardware} does not decode it on this machine ({reason(error)}); leave --hardware out"
        ) from None
