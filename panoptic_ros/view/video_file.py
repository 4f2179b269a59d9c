"""Video file writer on PyAV: H.264 in MP4 or QuickTime, which browsers play."""

from __future__ import annotations

import os
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import cast

import av
import cv2
import numpy as np
from av.audio.stream import AudioStream
from av.container import OutputContainer
from av.video.stream import VideoStream

from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.io.files import file_errors

Array = np.ndarray
SUFFIXES = (".mp4", ".mov")
MATRIX, RANGE = 5, 1  # FFmpeg codes of BT.601 and its limited range, which OpenCV converts to
MPEG4_QUANTISER = 3
GOOD = 23  # libx264 CRF at which compression artefacts are hard to see
FINE = 12  # libx264 CRF without visible artefacts, for images that detectors process


@dataclass(frozen=True)
class VideoAudio:
    """Sound track.

    Args:
        samples: Samples (N, C) in -1..1.
        sample_rate: Sample rate in Hz.
        begin_s: Time of the first sample after the first picture, s.
    """

    samples: Array
    sample_rate: int
    begin_s: float = 0.0


class VideoFile:
    """Video writer. The file appears under its final name only when it is complete.

    The codec is H.264 where FFmpeg has it, else MPEG-4, which browsers do not play. Encoding uses one thread,
    so that equal pictures give equal bytes on every machine. Sound is AAC in .mp4 and 16-bit PCM in .mov.

    The writer is a context manager. Leaving it normally closes the file; leaving it with an exception
    discards the file. Without a picture no file is made.

    Args:
        path: Path that ends in .mp4 or .mov.
        size: Picture size (width, height) px, even.
        frame_rate: Frame rate in Hz.
        quality: `GOOD` or `FINE`. A smaller value gives better quality and a larger file.
        sound: Optional sound track.

    Raises:
        UsageError: For impossible arguments.
        EnvironmentProblem: If the file cannot be written.
    """

    def __init__(
        self,
        path: Path,
        size: tuple[int, int],
        frame_rate: float,
        *,
        quality: int = GOOD,
        sound: VideoAudio | None = None,
    ):
        self.path = Path(path)
        self.size = (int(size[0]), int(size[1]))
        self.frame_count = 0
        if self.path.suffix.lower() not in SUFFIXES:
            raise UsageError(f"a video is written as {' or '.join(SUFFIXES)}, not {self.path.name}")
        if min(self.size) < 2 or self.size[0] % 2 or self.size[1] % 2 or not 0.01 <= frame_rate <= 1000.0:
            raise UsageError(f"a video of {size[0]}x{size[1]} px at {frame_rate} Hz; px must be even")
        self._rate = Fraction(frame_rate).limit_denominator(1001)
        self._next = 0
        self._temporary = self.path.with_name(f".{self.path.stem}.{os.getpid()}.part{self.path.suffix}")
        with file_errors(self.path, "write"):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._container: OutputContainer | None = av.open(
                str(self._temporary), "w", options={"movflags": "+faststart", **_exact(sound)}
            )
        self._pictures = _picture_track(self._container, self.size, self._rate, quality)
        self._sound = None if sound is None else _SoundTrack(self._container, self.path, sound)

    def write(self, image: Array, number: int | None = None) -> None:
        """Add a BGR picture (H, W, 3) uint8.

        Args:
            number: Display time in frame periods since the first picture. Default: right after the previous
                picture.

        Raises:
            DataError: If size or type differ from the video's, or `number` is not later than the previous
                one.
            EnvironmentProblem: If it cannot be written.
        """
        if self._container is None:
            raise UsageError(f"{self.path} is closed already")
        if image.shape != (self.size[1], self.size[0], 3) or image.dtype != np.uint8:
            raise DataError(f"{image.dtype} {image.shape} for a video of {self.size[0]}x{self.size[1]}")
        number = self._next if number is None else number
        if number < self._next:
            raise DataError(f"{self.path}: picture {number} is not after the previous one")
        planes = cv2.cvtColor(image, cv2.COLOR_BGR2YUV_I420)
        frame = av.VideoFrame.from_ndarray(planes.view(np.uint8), format="yuv420p")
        frame.pts, frame.time_base = number, 1 / self._rate
        with file_errors(self.path, "write"):
            self._container.mux(self._pictures.encode(frame))
            if self._sound is not None:
                self._sound.write_until(number / self._rate)
        self._next, self.frame_count = number + 1, self.frame_count + 1

    def close(self) -> None:
        """Finish the file; a second call does nothing.

        Raises:
            EnvironmentProblem: If it cannot be written.
        """
        if self._container is None:
            return
        try:
            if self.frame_count:
                with file_errors(self.path, "write"):
                    self._container.mux(self._pictures.encode())
                    if self._sound is not None:
                        self._sound.finish()
                    container, self._container = self._container, None
                    container.close()
                    os.replace(self._temporary, self.path)
        finally:
            self.discard()

    def discard(self) -> None:
        """Discard the video and delete the temporary file."""
        container, self._container = self._container, None
        try:
            if container is not None:
                container.close()
        except (av.FFmpegError, OSError):
            pass  # closing fails again on a full disk, and the content is discarded anyway
        finally:
            self._temporary.unlink(missing_ok=True)

    def __enter__(self) -> VideoFile:
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        if kind is None:
            self.close()
        else:
            self.discard()


def codec() -> str:
    """Return FFmpeg's name of the video encoder: libx264 if available, else mpeg4."""
    return "libx264" if "libx264" in av.codecs_available else "mpeg4"


def _picture_track(
    container: OutputContainer, size: tuple[int, int], rate: Fraction, quality: int
) -> VideoStream:
    h264 = codec() == "libx264"
    options = {"preset": "ultrafast", "crf": str(quality)} if h264 else {}
    stream = cast(VideoStream, container.add_stream(codec(), rate=rate, options=options))
    stream.width, stream.height, stream.pix_fmt = *size, "yuv420p"
    context = stream.codec_context
    context.thread_count, context.colorspace, context.color_range = 1, MATRIX, RANGE
    if not h264:
        context.qmin = context.qmax = MPEG4_QUANTISER
    return stream


def _exact(sound: VideoAudio | None) -> dict[str, str]:
    """Return container options that align the tracks to the sample; by default FFmpeg rounds to ms."""
    return {} if sound is None else {"movie_timescale": str(sound.sample_rate)}


class _SoundTrack:
    """Sound track, encoded in step with the pictures."""

    def __init__(self, container: OutputContainer, path: Path, sound: VideoAudio):
        self._container, self._sound = container, sound
        codec = "aac" if path.suffix.lower() == ".mp4" else "pcm_s16le"
        self._layout = {1: "mono", 2: "stereo"}.get(sound.samples.shape[1], f"{sound.samples.shape[1]}c")
        self._stream = cast(AudioStream, container.add_stream(codec, rate=sound.sample_rate))
        self._stream.layout = self._layout
        if codec == "aac":
            self._stream.bit_rate = 128_000 * sound.samples.shape[1]
        self._size = 1024  # samples per audio frame, as AAC requires
        self._done = 0

    def write_until(self, seconds: Fraction) -> None:
        """Encode all audio frames that begin before `seconds` after the first picture."""
        sound = self._sound
        while self._done < len(sound.samples) and self._done / sound.sample_rate < seconds - sound.begin_s:
            part = np.ascontiguousarray(sound.samples[self._done : self._done + self._size].T, np.float32)
            packed = np.clip(np.rint(32767.0 * part.T), -32768, 32767).astype(np.int16).reshape(1, -1)
            aac = self._stream.codec_context.name == "aac"
            frame = av.AudioFrame.from_ndarray(
                part if aac else packed, format="fltp" if aac else "s16", layout=self._layout
            )
            frame.sample_rate, frame.time_base = sound.sample_rate, Fraction(1, sound.sample_rate)
            frame.pts = round(sound.begin_s * sound.sample_rate) + self._done
            self._container.mux(self._stream.encode(frame))
            self._done += self._size

    def finish(self) -> None:
        """Encode the remaining samples and flush the encoder."""
        self.write_until(Fraction(10**9))
        self._container.mux(self._stream.encode())
