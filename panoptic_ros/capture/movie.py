"""Decoding of video files through PyAV (FFmpeg): upright images, and where they lie in time.

Images are the bytes that OpenCV gives for the same file: FFmpeg's bicubic conversion to BGR.
"""
from __future__ import annotations

import re
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from av.codec.hwaccel import HWAccel, hwdevices_available
from av.container import InputContainer
from av.video.frame import VideoFrame
from av.video.reformatter import Interpolation, VideoReformatter
from av.video.stream import VideoStream

from panoptic_ros.capture.packets import decoded, reason
from panoptic_ros.errors import DataError, EnvironmentProblem, UserError
from panoptic_ros.io.loading import check_file

MILLISECOND = Fraction(1, 1000)  # Matroska keeps whole ones, also where such a file is copied to another kind
_NO_TIMES = 0x0080  # AVFMT_NOTIMESTAMPS of libavformat
_TURNS = {90: cv2.ROTATE_90_CLOCKWISE, 180: cv2.ROTATE_180, 270: cv2.ROTATE_90_COUNTERCLOCKWISE}


class Movie:
    """An open video file, which is read once from its beginning.

    Args:
        what: how messages call it.
        threads: decode several frames at once; not worth it for the first frame alone.
        hardware: what decodes, as FFmpeg calls it (cuda, qsv, ...); "" = the processor.

    Raises:
        DataError: if it cannot be opened, has no video track, or one of an unknown codec.
        EnvironmentProblem: if the hardware is not there or does not decode this.
    """

    def __init__(self, path: Path, what: str, *, threads: bool = True, hardware: str = ""):
        self._what = what
        self._container = open_media(path, what, hardware)
        try:
            self._stream = self._choose()
            if threads and not hardware:
                self._stream.thread_type = "AUTO"
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
    def frame_rate(self) -> float:
        """Hz, as the file says; 0 = it does not."""
        return float(self._stream.guessed_rate or 0)

    @property
    def tick(self) -> Fraction:
        """What the file rounds times to, s."""
        return self._stream.time_base or Fraction(0)

    @property
    def frame_count(self) -> int | None:
        """As the file says: counted, or its duration times its rate; None = it says neither."""
        if self._stream.frames > 0:
            return int(self._stream.frames)
        return int(self._duration * Fraction(self.frame_rate) + Fraction(1, 2)) or None

    @property
    def _duration(self) -> Fraction:
        """How long the images are shown, s, as the file says; 0 = it does not. Sound may last longer."""
        told = re.fullmatch(r"(\d+):(\d\d):(\d\d(?:\.\d+)?)", self._stream.metadata.get("DURATION", ""))
        if told:  # Matroska, of whose tracks FFmpeg knows no better than how long the file is
            hours, minutes, seconds = (Fraction(part) for part in told.groups())
            return 3600 * hours + 60 * minutes + seconds
        if self._stream.duration:
            return Fraction(self._stream.duration * self.tick)
        return Fraction(self._container.duration or 0, av.time_base)

    @property
    def sound_end(self) -> Fraction:
        """Where the last sound ends, s, of what the file really holds; reads all of it. 0 = there is none."""
        end, tracks = Fraction(0), self._container.streams.audio
        for packet in self._container.demux(*tracks) if tracks else ():
            if packet.pts is not None and packet.time_base is not None:
                end = max(end, (packet.pts + (packet.duration or 0)) * packet.time_base)
        return end

    def frames(self) -> Iterator[VideoFrame]:
        """Frames as they are decoded; what cannot be is left out.

        Raises:
            DataError: if the file cannot be read on, after all frames before.
        """
        for images in decoded(self._container, self._stream, self._what):
            while images:  # nothing is kept, so that their memory serves later ones
                frame = images.pop(0)
                if isinstance(frame, VideoFrame):
                    yield frame
                del frame

    @property
    def has_sound(self) -> bool:
        """Whether there is a sound track."""
        return bool(self._container.streams.audio)

    def frame_times(self) -> list[Fraction]:
        """When all frames are shown, s, by the index of the file or what stands before each; none is decoded.

        Raises:
            DataError: if the file cannot be read on.
        """
        try:
            shown = [
                packet.dts if packet.pts is None else packet.pts
                for packet in self._container.demux(self._stream) if packet.size and not packet.is_discard
            ]  # fmt: skip
        except (av.FFmpegError, OSError) as error:
            raise DataError(f"{self._what} cannot be read on: {reason(error)}") from None
        return [ticks * self.tick for ticks in sorted(ticks for ticks in shown if ticks is not None)]

    def close(self) -> None:
        """Close the file; may be called twice."""
        self._container.close()


class Converter:
    """Decoded frames as upright images."""

    def __init__(self) -> None:
        self._reformatter = VideoReformatter()

    def image(self, frame: VideoFrame) -> np.ndarray:
        """(H, W, 3) uint8 BGR, turned as the file's rotation mark says.

        Raises:
            DataError: if the frame is in a format that FFmpeg cannot convert, as in a damaged file.
        """
        try:
            bgr = self._reformatter.reformat(
                frame, format="bgr24", interpolation=Interpolation.BICUBIC, threads=1
            )  # one thread: every camera has its own
            pixels = bgr.to_ndarray()
        except (av.FFmpegError, OSError, ValueError) as error:
            kind = getattr(frame.format, "name", "unknown")
            raise DataError(
                f"a video frame of {frame.width}x{frame.height}, format {kind}, cannot be converted to an "
                f"image ({reason(error)}); the file is damaged"
            ) from None
        turn = turned(frame)
        return cv2.rotate(pixels, _TURNS[turn]) if turn in _TURNS else np.ascontiguousarray(pixels)


def turned(frame: VideoFrame) -> int:
    """By how many degrees the file says that its images are to be turned clockwise, in 0..359."""
    return -int(frame.rotation) % 360


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
