"""Decode sound tracks of files through PyAV (FFmpeg): samples and their times in the file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
from av.audio.frame import AudioFrame
from av.audio.stream import AudioStream

from panoptic_ros.capture.movie import open_media, rounding
from panoptic_ros.capture.packets import decoded
from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.io.wav import read_wav

Array = np.ndarray
# s, gap between non-consecutive samples. The jitter of recorder clocks is smaller.
GAP_S = Fraction(1, 50)


@dataclass(frozen=True)
class TrackSamples:
    """Consecutive samples.

    Args:
        first: index of the first sample since the beginning of the track.
        time: time of the first sample, s.
        sample_rate: Hz.
        samples: (N, C) float32.
    """

    first: int
    time: Fraction
    sample_rate: int
    samples: Array


class SoundTrack:
    """Open sound track of a file, which is read once from its beginning.

    Samples that FFmpeg discards at the beginning (priming of AAC and Opus, edit lists) are not included.
    Times that agree with the sample count, within the file's rounding, are set to it. Other times are used
    unchanged. If more than 20 ms of sound are missing, the sample count has a gap.

    Args:
        what: subject of error messages.
        number: number of the track among the sound tracks.

    Raises:
        DataError: if the file cannot be opened, the track is missing, or its codec is unknown.
    """

    def __init__(self, path: Path, what: str, number: int = 0):
        self._what = what
        self._container = open_media(path, what)
        try:
            streams = self._container.streams.audio
            if not streams:
                raise DataError(f"{what}: there is no sound track")
            if number >= len(streams):
                raise DataError(f"{what}: there are {len(streams)} tracks, counted from 0, and no {number}")
            self._stream: AudioStream = streams[number]
            if self._stream.codec_context is None:
                raise DataError(f"{what}: FFmpeg has no decoder for its codec; convert it")
        except BaseException:
            self.close()
            raise

    @property
    def channels(self) -> int:
        """Return the number of channels."""
        return int(self._stream.codec_context.channels)

    def pieces(self) -> Iterator[TrackSamples]:
        """Yield the sound in order; skip packets that cannot be decoded.

        Raises:
            DataError: if the rest of the file cannot be read.
        """
        count = _SampleCounter(self._stream.time_base or Fraction(0))
        for frame in self._frames():
            samples = _samples(frame)
            placed = count.place(_heard_at(frame), len(samples), frame.sample_rate)
            if placed is not None:
                yield TrackSamples(*placed, frame.sample_rate, samples)

    def _frames(self) -> Iterator[AudioFrame]:
        for _, frames in decoded(self._container, self._stream, self._what):
            yield from (frame for frame in frames or () if isinstance(frame, AudioFrame) and frame.samples)

    def close(self) -> None:
        """Close the file; may be called twice."""
        self._container.close()

    def __enter__(self) -> SoundTrack:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


class _SampleCounter:
    """Sample counter that is compared with the times in a file."""

    def __init__(self, tick: Fraction):
        self._tick = tick
        self._next = 0
        self._expected: Fraction | None = None  # time of the next sample
        self._even = True  # all times so far agreed with the count

    def place(self, time: Fraction | None, length: int, rate: int) -> tuple[int, Fraction] | None:
        """Return index and time (s) of the first of `length` samples; None if they precede earlier ones."""
        if self._expected is None:
            self._expected = Fraction(0) if time is None else time
        late = Fraction(0) if time is None else time - self._expected
        if late < -GAP_S:
            return None
        if late > GAP_S:
            self._next += round(late * rate)
            self._even = True
        elif self._even and time is not None:
            self._even = abs(late) <= rounding(time, self._tick)
        first, begin = self._next, self._expected
        if late > GAP_S or not self._even:
            begin = self._expected + late
        self._next += length
        self._expected = begin + Fraction(length, rate)
        return first, begin


def _heard_at(frame: AudioFrame) -> Fraction | None:
    """Return the presentation time of a frame, s; None if the file does not state it."""
    return None if frame.pts is None or frame.time_base is None else frame.pts * frame.time_base


def _samples(frame: AudioFrame) -> Array:
    """Return the samples of a frame, (N, C) float32 in -1..1."""
    stored: Array = frame.to_ndarray()
    stored = stored.reshape(-1, frame.layout.nb_channels) if frame.format.is_packed else stored.T
    if stored.dtype == np.uint8:
        return ((stored.astype(np.float32) - 128.0) / 128.0).astype(np.float32)
    if stored.dtype.kind == "i":
        return (stored / 2.0 ** (8 * stored.itemsize - 1)).astype(np.float32)
    return np.ascontiguousarray(stored, np.float32)


def known_tracks(path: Path) -> list[int]:
    """Return the numbers of a file's sound tracks that can be decoded, counted from 0.

    Raises:
        DataError: if it cannot be opened.
    """
    with closing(open_media(path, str(path))) as container:
        return [k for k, track in enumerate(container.streams.audio) if track.codec_context is not None]


def read_sound(path: Path, channel: int = 0) -> tuple[int, Array]:
    """Read the sample rate (Hz) and one channel (N,) float32 of a WAV file or a sound track.

    Raises:
        DataError, UsageError: as `read_wav` and `read_track`.
    """
    return read_wav(path, channel) if path.suffix.lower() == ".wav" else read_track(path, channel)


def read_track(path: Path, channel: int = 0) -> tuple[int, Array]:
    """Read the sample rate (Hz) and one channel (N,) float32 of the first track that can be decoded.

    Missing samples are 0.

    Raises:
        DataError: as `SoundTrack`; if there are no samples.
        UsageError: if the channel does not exist.
    """
    with SoundTrack(path, str(path), next(iter(known_tracks(path)), 0)) as track:
        if not 0 <= channel < track.channels:
            raise UsageError(f"{path} has {track.channels} channels, counted from 0; there is no {channel}")
        pieces = list(track.pieces())
    if not pieces:
        raise DataError(f"{path} has no samples")
    samples = np.zeros(pieces[-1].first + len(pieces[-1].samples), np.float32)
    for piece in pieces:
        samples[piece.first : piece.first + len(piece.samples)] = piece.samples[:, channel]
    return pieces[0].sample_rate, samples
