"""Decoding of video files through PyAV (FFmpeg): frames, and where they lie in time."""

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

MILLISECOND = Fraction(1, 1000)  # Matroska keeps whole ones, also where such a file is copied to another kind
_NO_TIMES = 0x0080  # AVFMT_NOTIMESTAMPS of libavformat
_NO_ZERO = 0x0200  # AVFMT_TS_DISCONT: times begin anywhere, as in MPEG-TS
_IN_ORDER_OF_DECODING = {"avi"}  # formats that number frames as they are stored, not as they are shown
_REORDERED = 64  # packets in which the reordering of frames shows; codecs allow 16 frames


class Movie:
    """An open video file, which is read once from its beginning.

    Args:
        what: how messages call it.
        threads: decode several frames at once; not worth it for the first frame alone.
        hardware: what decodes, as FFmpeg calls it (cuda, qsv, ...); "" = the processor.
        skip_damaged: leave out what is damaged: frames that decoders patch up, and those that build on them.

    Raises:
        DataError: if it cannot be opened, has no video track, or one of an unknown codec.
        EnvironmentProblem: if the hardware is not there or does not decode this.
    """

    def __init__(
        self, path: Path, what: str, *, threads: bool = True, hardware: str = "", skip_damaged: bool = False
    ):
        self._what = what
        self._container = open_media(path, what, hardware)
        self._by_storage = self._container.format.name in _IN_ORDER_OF_DECODING
        self.lost = 0  # frames that could not be decoded, after the first that could be
        self.patched = 0  # frames of which parts could not be decoded
        self._damage = Damage() if skip_damaged else None
        try:
            self._stream = self._choose()
            if threads and not hardware:
                # slices: errors come with their packet
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
        """Whether this kind of file can say when its frames are shown; raw streams cannot."""
        return not self._container.format.flags & _NO_TIMES

    @property
    def has_zero(self) -> bool:
        """Return whether times of this kind of file count from the beginning of the recording."""
        return self.has_times and not self._container.format.flags & _NO_ZERO

    @property
    def frame_rate(self) -> float:
        """Hz, as the file says; 0 = it does not."""
        return float(self._stream.guessed_rate or 0)

    @property
    def tick(self) -> Fraction:
        """What the file rounds times to, s."""
        return self._stream.time_base or Fraction(0)

    def frame_count(self, begin: Fraction) -> int | None:
        """Return the number of frames that the file states, or its duration times its rate; None = neither.

        Args:
            begin: when the first frame is shown, s.
        """
        if self._stream.frames > 0:
            return int(self._stream.frames)
        return int(self._duration(begin) * Fraction(self.frame_rate) + Fraction(1, 2)) or None

    def _duration(self, begin: Fraction) -> Fraction:
        """Return the duration of the images that the file states, s; 0 = it states none."""
        told = re.fullmatch(r"(\d+):(\d\d):(\d\d(?:\.\d+)?)", self._stream.metadata.get("DURATION", ""))
        if told:  # Matroska, of whose tracks FFmpeg knows no better than how long the file is
            hours, minutes, seconds = (Fraction(part) for part in told.groups())
            end = 3600 * hours + 60 * minutes + seconds
        elif self._stream.duration:
            return Fraction(self._stream.duration * self.tick)
        else:
            end = Fraction(self._container.duration or 0, av.time_base)
        return max(Fraction(0), end - begin) if self.has_zero else end  # else it is what FFmpeg found

    @property
    def tells_end(self) -> bool:
        """Return whether the file states the end of its last image, or their number."""
        return self._stream.frames > 0 or "DURATION" in self._stream.metadata

    @property
    def timecode(self) -> str:
        """HH:MM:SS:FF of the first frame, as a timecode track or a mark of the file says; "" = none does."""
        tracks = [self._stream.metadata, *(track.metadata for track in self._container.streams.data)]
        for metadata in (*tracks, self._container.metadata):
            for key, value in metadata.items():
                if key.casefold() == "timecode":
                    return str(value).strip()
        return ""

    @property
    def sound_end(self) -> Fraction:
        """Where the last sound ends, s, of what the file really holds; reads all of it. 0 = there is none."""
        end, tracks = Fraction(0), self._container.streams.audio
        for packet in self._container.demux(*tracks) if tracks else ():
            if packet.pts is not None and packet.time_base is not None:
                end = max(end, (packet.pts + (packet.duration or 0)) * packet.time_base)
        return end

    def frames(self) -> Iterator[VideoFrame]:
        """Frames in the order in which they are shown, with times; what cannot be decoded is left out.

        Raises:
            DataError: if the file cannot be read on, after all frames before.
        """
        times: list[int] = []  # packets whose frames are not shown yet
        begun = False
        for packet, images in decoded(self._container, self._stream, self._what):
            if images is None:
                self.lost += begun and packet.size > 0
                if self._damage is not None:
                    self._damage.lost(self._time_of(packet))
            elif self._by_storage and packet.size and packet.dts is not None:
                heapq.heappush(times, packet.dts)
            begun = begun or bool(images)
            while images:  # nothing is kept, so that their memory serves later ones
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
        """Return the number of frames that were decoded but are damaged, or build on such."""
        return 0 if self._damage is None else self._damage.left_out

    def frame_times(self) -> list[Fraction]:
        """When all frames are shown, s, by the index of the file or what stands before each; none is decoded.

        Raises:
            DataError: if the file cannot be read on.
        """
        return [ticks * self.tick for ticks in sorted(self._shown())]

    def reordering(self) -> int:
        """Return by how many frames one is stored after its turn at most; read the first packets."""
        stored = list(islice(self._shown(), _REORDERED))
        place = {ticks: k for k, ticks in enumerate(sorted(stored))}
        return max((k - place[ticks] for k, ticks in enumerate(stored)), default=0)

    def _shown(self) -> Iterator[int]:
        """Yield the times of the packets in the order in which they are stored, in ticks."""
        try:
            for packet in self._container.demux(self._stream):
                time = self._time_of(packet)
                if packet.size and not packet.is_discard and time is not None:
                    yield time
        except (av.FFmpegError, OSError) as error:
            raise DataError(f"{self._what} cannot be read on: {reason(error)}") from None

    def _time_of(self, packet: Packet[Any]) -> int | None:
        """Return the time at which the frame of a packet is shown, or else decoded, in ticks."""
        return packet.dts if packet.pts is None or self._by_storage else packet.pts

    def close(self) -> None:
        """Close the file; may be called twice."""
        self._container.close()


class Damage:
    """Damaged stretches: from a lost or patched frame to the next key frame."""

    def __init__(self) -> None:
        self.left_out = 0
        self._begin: int | None = None  # first tick of a damaged stretch
        self._last = 0  # last tick in it that is known to be damaged

    def lost(self, time: int | None) -> None:
        """Remember a frame that could not be decoded."""
        if time is not None:
            self._last = time if self._begin is None else max(self._last, time)
            self._begin = time if self._begin is None else min(self._begin, time)

    def spares(self, frame: VideoFrame) -> bool:
        """Return whether a frame is good; frames come in the order in which they are shown."""
        time = frame.dts if frame.pts is None else frame.pts
        if frame.is_corrupt:
            self.lost(time)
        if self._begin is not None and time is not None and time > self._last and frame.key_frame:
            self._begin = None
        good = not frame.is_corrupt and (self._begin is None or (time is not None and time < self._begin))
        self.left_out += not good
        return good


def shown_at(frame: VideoFrame) -> Fraction | None:
    """When a frame is shown, s; None = the file does not say."""
    ticks = frame.dts if frame.pts is None else frame.pts
    return None if ticks is None or frame.time_base is None else ticks * frame.time_base


def rounding(time: Fraction, tick: Fraction) -> Fraction:
    """By how much rounding may change a time less another one of a file, s.

    Args:
        tick: what the file says that it rounds to.
    """
    return max(tick, MILLISECOND) if time % MILLISECOND == 0 else tick


def open_media(path: Path, what: str, hardware: str = "") -> InputContainer:
    """Open a file for reading.

    Args:
        hardware: that decodes, see `Movie`; never another way in its place.

    Raises:
        DataError: if it cannot be.
        EnvironmentProblem: if the hardware cannot.
    """
    try:
        check_file(path)
        container = av.open(str(path))
    except UserError:
        raise
    except Exception as error:  # PyAV decodes the texts of a file, too
        raise DataError(f"{what} cannot be opened: no video, or damaged ({reason(error)})") from None
    if not hardware:
        return container
    container.close()
    known = hwdevices_available()
    if hardware not in known:
        raise EnvironmentProblem(f"FFmpeg knows no {hardware} here; there are {', '.join(known) or 'none'}")
    try:
        return av.open(str(path), hwaccel=HWAccel(device_type=hardware, allow_software_fallback=False))
    except (av.FFmpegError, OSError, RuntimeError) as error:
        raise EnvironmentProblem(
            f"{what}: {hardware} does not decode it on this machine ({reason(error)}); leave --hardware out"
        ) from None
