"""Audio of a video file, with timestamps consistent with the video frames."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np

from panoptic_ros.capture.movie import Movie, shown_at
from panoptic_ros.capture.sound.source import BLOCK_S
from panoptic_ros.capture.sound.track import SoundTrack, TrackSamples
from panoptic_ros.domain import AudioBlock
from panoptic_ros.errors import DataError

Array = np.ndarray
SECOND = 1_000_000_000
ANCHOR_S = 1.0  # s of frames whose timestamps are averaged, because they jitter and sound does not


class VideoSound:
    """Sound track of a video file.

    A sample has the timestamp of a video frame with the same presentation time. Samples with a timestamp
    below 0 are skipped.

    Args:
        device: Its camera.
        clocks: Clocks of the channels, see `AudioBlock`.
        start_ns: Timestamp of the first frame of the video.
        stamps: Timestamps of all frames, ns, if they are not the file's own times.
        from_sample: Index of the first sample to read.
        track: Number among the sound tracks.

    Raises:
        DataError: if there is no video or no sound track, its codec is unknown, or the number of channels
            differs from `clocks`. While iterating: if the rest of the file cannot be read.
    """

    def __init__(
        self,
        device: str,
        path: Path,
        *,
        clocks: Sequence[str] = (),
        start_ns: int = 0,
        stamps: Sequence[int] = (),
        from_sample: int = 0,
        track: int = 0,
    ):
        self.device, self.path = device, Path(path)
        self.clocks = tuple(clocks)
        self._what = f"the sound of {self.path}"
        self._from, self._track = from_sample, track
        self._open_now: list[SoundTrack] = []
        with SoundTrack(self.path, self._what, track) as opened:
            self.channels = opened.channels
        if self.clocks and len(self.clocks) != self.channels:
            raise DataError(
                f"{len(self.clocks)} channels of {path} are named ({', '.join(self.clocks)}), but its sound "
                f"has {self.channels}"
            )
        self._start_ns = int(stamps[0]) if len(stamps) else int(start_ns)
        self._begin, self._anchors = self._look(stamps)

    def __iter__(self) -> Iterator[AudioBlock]:
        track = SoundTrack(self.path, self._what, self._track)
        self._open_now.append(track)
        try:
            for piece in _joined(track.pieces()):
                step = int(BLOCK_S * piece.sample_rate)
                for k in range(0, len(piece.samples), step):
                    block = self._block(piece, k, min(k + step, len(piece.samples)))
                    if block is not None:
                        yield block
                    if track not in self._open_now:  # the source was closed meanwhile
                        return
        finally:
            self._release(track)

    def close(self) -> None:
        """Close the file; running iterations end."""
        for track in list(self._open_now):
            self._release(track)

    def __enter__(self) -> VideoSound:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _release(self, track: SoundTrack) -> None:
        track.close()
        if track in self._open_now:
            self._open_now.remove(track)

    def _block(self, piece: TrackSamples, begin: int, end: int) -> AudioBlock | None:
        """Return a block of samples begin..end of a piece; None if all are before the start."""
        early = -self._stamp(piece.time + Fraction(begin, piece.sample_rate))
        begin += max(0, self._from - piece.first - begin, -(-early * piece.sample_rate // SECOND))
        if begin >= end:
            return None
        stamp = max(0, self._stamp(piece.time + Fraction(begin, piece.sample_rate)))
        return AudioBlock(
            self.device, stamp, piece.first + begin, piece.sample_rate, piece.samples[begin:end], self.clocks
        )

    def _stamp(self, time: Fraction) -> int:
        """Return the timestamp (ns) of a file time; the offset is constant outside of the frame range."""
        since = time - self._begin
        if self._anchors is None:
            return self._start_ns + round(since * SECOND)
        seconds, late = self._anchors
        return self._start_ns + round(since * SECOND) + round(float(np.interp(float(since), seconds, late)))

    def _look(self, stamps: Sequence[int]) -> tuple[Fraction, tuple[Array, Array] | None]:
        """Return the time of the first frame (s) and the delay of timestamps against file times.

        The delay is given at times (s) since the first frame, in ns; None if there are no timestamps.
        """
        movie = Movie(self.path, self._what, threads=False)
        try:
            first = next(movie.frames(), None)
        finally:
            movie.close()
        begin = (shown_at(first) if first is not None else None) or Fraction(0)
        if not len(stamps):
            return begin, None
        movie = Movie(self.path, self._what, threads=False)
        try:
            times = [time - begin for time in movie.frame_times() if time >= begin]
        finally:
            movie.close()
        late = [stamp - stamps[0] - round(time * SECOND) for time, stamp in zip(times, stamps)]
        return begin, _averaged(np.array(times, float), np.array(late, float))


def _averaged(seconds: Array, late: Array) -> tuple[Array, Array]:
    """Return the means over intervals of `ANCHOR_S`."""
    number = (seconds // ANCHOR_S).astype(int)
    _, which, count = np.unique(number, return_inverse=True, return_counts=True)
    return np.bincount(which, seconds) / count, np.bincount(which, late) / count


def _joined(pieces: Iterator[TrackSamples]) -> Iterator[TrackSamples]:
    """Join consecutive pieces up to the length of a block."""
    waiting: list[TrackSamples] = []
    for piece in pieces:
        if waiting and not _follows(waiting, piece):
            yield _together(waiting)
            waiting = []
        waiting.append(piece)
    if waiting:
        yield _together(waiting)


def _follows(waiting: Sequence[TrackSamples], piece: TrackSamples) -> bool:
    """Return whether a piece continues the waiting ones within the length of a block."""
    first, last = waiting[0], waiting[-1]
    return (
        piece.first == last.first + len(last.samples)
        and piece.sample_rate == first.sample_rate
        and piece.samples.shape[1] == first.samples.shape[1]
        and piece.first + len(piece.samples) - first.first <= BLOCK_S * first.sample_rate
    )


def _together(pieces: Sequence[TrackSamples]) -> TrackSamples:
    return replace(pieces[0], samples=np.concatenate([piece.samples for piece in pieces]))
