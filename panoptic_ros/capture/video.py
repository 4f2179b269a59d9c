"""Video files as sources of frames: every frame once, upright, at its presentation time."""
from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path

from av.video.frame import VideoFrame

from panoptic_ros.capture.container import find_cut, hidden_seconds
from panoptic_ros.capture.movie import Converter, Movie, rounding, shown_at, turned
from panoptic_ros.capture.source import SECOND_NS, check_stamps, exact_rate
from panoptic_ros.domain import ViewFrame
from panoptic_ros.errors import DataError


class VideoSource:
    """The frames of a video file. Iterating starts at the first frame every time.

    Images are upright: they are turned as the file's rotation mark says, so that a phone's
    portrait video is portrait here and `image_size` is the size after turning; `notices` tell of it.

    Stamps: those given; else start_ns + i / frame_rate if a frame rate is given; else the
    container's, counted from its first frame. Container times that lie on the grid of the file's
    own frame rate, as nearly as the file rounds times, are set to it exactly, so a constant rate gives
    start_ns + i / rate without drift, also after frames that the recorder left out. From the first
    frame off the grid on (a variable rate), the container's times are used as they are. Where the
    container has none that increase, the frame comes one period after the one before, and is counted
    in `repaired_stamps`.

    Args:
        camera: name.
        path: any file that FFmpeg reads.
        start_ns: stamp of the first frame, ns.
        frame_rate: Hz, in place of the file's own times.
        stamps: ns, one per frame, in place of all others.
        hardware: that decodes, see `Movie`.

    Raises:
        DataError: missing, not a video, without frames, without times or rate, cut off. While iterating:
            fewer frames can be decoded than the file says, after all good ones have been handed out.
    """

    def __init__(
        self,
        camera: str,
        path: Path,
        *,
        start_ns: int = 0,
        frame_rate: float | None = None,
        stamps: Sequence[int] | None = None,
        hardware: str = "",
    ):
        self.camera = camera
        self._hardware = hardware
        self.path = Path(path)
        self.repaired_stamps = 0
        self.notices: tuple[str, ...] = ()
        self._what = f"video {self.path} of camera {camera}"
        self._start_ns = int(start_ns)
        self._stamps = None if stamps is None else check_stamps(stamps, self._what)
        self._open_now: list[Movie] = []
        movie = self._open(look=True)
        try:
            own_rate = self._look(movie)
        finally:
            self._release(movie)
        timed = frame_rate is not None or self._stamps is not None or movie.has_times
        if frame_rate is None and (not timed or not 0.01 <= own_rate <= 10_000.0):
            lack = "does not say its frame rate" if timed else "is a raw stream without times of its frames"
            raise DataError(f"{self._what} {lack}; give one (--frame-rate)")
        self._own_rate = own_rate
        self._given_rate = frame_rate is not None
        self._rate = exact_rate(own_rate if frame_rate is None else frame_rate, self._what)
        self.frame_rate = float(self._rate)
        if self._stamps is not None and self.frame_count and len(self._stamps) < self.frame_count:
            raise DataError(f"{self._what} has {self.frame_count} frames but {len(self._stamps)} stamps")

    def __iter__(self) -> Iterator[ViewFrame]:
        movie = self._open()
        timeline = _Timeline(self._rate, self._given_rate, movie.tick)
        converter = Converter()
        self.repaired_stamps = 0
        number = 0
        try:
            frames = movie.frames()
            while movie in self._open_now:  # until close()
                frame = self._next(frames, number, timeline)
                if frame is None:
                    return
                seconds = timeline.step(number, shown_at(frame))
                self.repaired_stamps = timeline.repaired
                image = converter.image(frame)
                del frame  # its memory serves the next one
                yield ViewFrame(self.camera, self._stamp(number, seconds), number, image)
                del image
                number += 1
        finally:
            self._release(movie)

    def close(self) -> None:
        """Close the file; iterations that are under way end."""
        for movie in list(self._open_now):
            self._release(movie)

    def __enter__(self) -> VideoSource:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _open(self, look: bool = False) -> Movie:
        if not self.path.is_file():
            state = "is a folder" if self.path.is_dir() else "is not there"
            raise DataError(f"{self._what} {state}; check the path")
        if self.path.stat().st_size == 0:
            raise DataError(f"{self._what} is empty (0 bytes); record or copy it again")
        cut = find_cut(self.path)
        if cut:
            raise DataError(f"{self._what} is cut off: {cut}; copy or record it again")
        movie = Movie(self.path, self._what, threads=not look, hardware=self._hardware)
        self._open_now.append(movie)
        return movie

    def _release(self, movie: Movie) -> None:
        movie.close()
        if movie in self._open_now:
            self._open_now.remove(movie)

    def _look(self, movie: Movie) -> float:
        """Take size, turn and count from a file and its first frame; its frame rate in Hz, 0 = not known."""
        first = next(movie.frames(), None)
        if first is None:
            raise DataError(f"{self._what} has no frame that can be decoded; record or copy it again")
        height, width = Converter().image(first).shape[:2]
        self.image_size = (width, height)
        self.frame_count = movie.frame_count
        self.has_sound = movie.has_sound
        if turned(first):
            told = f"camera {self.camera}: images are turned clockwise by {turned(first)} degrees, as marked"
            self.notices = (f"{told} in {self.path.name}",)
        return movie.frame_rate

    def _next(self, frames: Iterator[VideoFrame], number: int, timeline: _Timeline) -> VideoFrame | None:
        """The next frame; at the end None, if all that were promised came."""
        try:
            frame = next(frames, None)
        except DataError:
            self._check_end(number, timeline.seconds)
            raise
        if frame is None:
            self._check_end(number, timeline.seconds)
        return frame

    def _stamp(self, number: int, seconds: Fraction) -> int:
        if self._stamps is None:
            return self._start_ns + round(seconds * SECOND_NS)
        if number >= len(self._stamps):
            raise DataError(f"{self._what} has more frames than the {len(self._stamps)} stamps given")
        return self._stamps[number]

    def _sound_end(self) -> Fraction:
        """Where the last sound of the file ends, s: it may be what lasts as long as the file says."""
        movie = self._open(look=True)
        try:
            return movie.sound_end
        finally:
            self._release(movie)

    def _check_end(self, decoded: int, last: Fraction) -> None:
        """Complain if the file promised more than could be decoded."""
        promised = self.frame_count
        if promised is None or decoded >= promised:
            return
        hidden = hidden_seconds(self.path)
        if hidden == math.inf:
            # the count is no more than duration times rate: compare times, as rates may vary
            told = promised / self._rate
            slack = max(Fraction(1), told / 50)
            if told - last - 1 / self._rate <= slack or told - self._sound_end() <= slack:
                return
        elif promised - decoded <= hidden * self._own_rate + 0.5:
            return
        raise DataError(
            f"{self._what}: only {decoded} of {promised} frames could be decoded; "
            "the file is damaged or cut off, copy or record it again"
        )


class _Timeline:
    """Seconds since the first frame, from what the container says."""

    def __init__(self, rate: Fraction, ignore_container: bool, tick: Fraction):
        self.rate = rate
        self.seconds = Fraction(-1)
        self.repaired = 0
        self._ignore = ignore_container
        self._tick = tick
        self._first = Fraction(0)
        self._on_grid = True

    def step(self, number: int, container: Fraction | None) -> Fraction:
        """Time of frame `number`; `container` is its presentation time in the file, s, None = unknown."""
        if number == 0:
            self._first = container or Fraction(0)
            self.seconds = Fraction(0)
        elif self._ignore:
            self.seconds = number / self.rate
        else:
            self.seconds = self._next(None if container is None else container - self._first)
        return self.seconds

    def _next(self, since_first: Fraction | None) -> Fraction:
        if since_first is None:
            return self._repaired()
        nearest = round(since_first * self.rate) / self.rate
        self._on_grid = self._on_grid and abs(since_first - nearest) <= rounding(since_first, self._tick)
        seconds = nearest if self._on_grid else since_first
        return seconds if seconds > self.seconds else self._repaired()

    def _repaired(self) -> Fraction:
        self.repaired += 1
        return self.seconds + 1 / self.rate
