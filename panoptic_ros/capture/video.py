"""Video files as frame sources: every frame once, upright, at its presentation time."""

from __future__ import annotations

import bisect
import math
from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path

from av.video.frame import VideoFrame

from panoptic_ros.capture.container import find_cut, has_edits, hidden_seconds, timecode_rate
from panoptic_ros.capture.movie import Movie, rounding, shown_at
from panoptic_ros.capture.source import SECOND_NS, check_stamps, exact_rate
from panoptic_ros.capture.starts import TimecodeLabel, read_label
from panoptic_ros.capture.upright import UPRIGHT, Converter, orientation_of, whole_images
from panoptic_ros.domain import ViewFrame
from panoptic_ros.errors import DataError
from panoptic_ros.stage import Notice

NEARLY = Fraction(1, 20)  # frame periods, tolerance for rounded times in a file
# s, tolerance between the end that a track states and the end of its last frame
SLACK_S = Fraction(1, 4)
SKIP = "leave out the damaged frames with --skip-damaged"


class VideoSource:
    """Frames of a video file. Every iteration starts at the first frame.

    Images are upright: they are rotated and mirrored by the file's display matrix. A phone's portrait video
    is therefore portrait here, and `image_size` is the size after rotation. Interlaced frames are reduced to
    their first field. `notices` reports both.

    The timestamps have three possible sources, in this order:

    - `stamps`, if given
    - start_ns + i / frame_rate, if a frame rate is given
    - the container's times, relative to its first frame

    Container times that lie on the grid of the file's own frame rate, within its rounding, are set to the
    grid. A constant rate then gives start_ns + i / rate without drift, even after frames that the recorder
    dropped. From the first frame off the grid (a variable rate), the container's times are used unchanged. If
    the container's time does not increase, the frame is placed one period after the previous one and counted
    in `repaired_stamps`.

    Args:
        camera: Name.
        path: Any file that FFmpeg reads.
        start_ns: Timestamp of the first frame, ns. The attribute may be changed when the start is found
            later.
        frame_rate: Hz; replaces the file's own times.
        stamps: Timestamps (ns), one per frame; they replace all others.
        hardware: Decoding hardware, see `Movie`.
        skip_damaged: Skip damaged frames instead of an error; see `Movie`.

    Attributes:
        late: Time (s) from the beginning of the recording to the first frame, as the file states; 0 if below
            a frame period.
        label: Timecode of the first frame, if there is one.
        notices: Changes of the images, without the camera name.
        after: Notices that are available after the last frame.

    Raises:
        DataError: if the file is missing, no video, without frames, without times or rate, or cut off. While
            iterating: if fewer frames can be decoded than the file states, after all good ones.
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
        skip_damaged: bool = False,
    ):
        self.camera = camera
        self._hardware, self._skip = hardware, skip_damaged
        self.path = Path(path)
        self.repaired_stamps = 0
        self.notices: tuple[str, ...] = ()
        self.after: tuple[Notice, ...] = ()
        self.late = Fraction(0)
        self.label: TimecodeLabel | None = None
        self.first: int | None = None
        self.step = 1
        self._what = f"video {self.path} of camera {camera}"
        self.start_ns = int(start_ns)
        self._stamps = None if stamps is None else check_stamps(stamps, self._what)
        self._open_now: list[Movie] = []
        movie = self._open(look=True)
        try:
            own_rate, begin, timecode = self._look(movie)
        finally:
            self._release(movie)
        timed = frame_rate is not None or self._stamps is not None or movie.has_times
        if frame_rate is None and (not timed or not 0.01 <= own_rate <= 10_000.0):
            lack = "does not state its frame rate" if timed else "is a raw stream without times of its frames"
            raise DataError(f"{self._what} {lack}; give one (--frame-rate)")
        self._own_rate = own_rate
        self._given_rate = frame_rate is not None
        self._rate = exact_rate(own_rate if frame_rate is None else frame_rate, self._what)
        self.frame_rate = float(self._rate)
        if self._stamps is not None and self.frame_count and len(self._stamps) < self.frame_count:
            raise DataError(f"{self._what} has {self.frame_count} frames but {len(self._stamps)} stamps")
        if frame_rate is None and self._stamps is None:
            self.late = self._lateness(begin)
            self.label = read_label(timecode, self._rate, timecode_rate(self.path))

    def __iter__(self) -> Iterator[ViewFrame]:
        places = self._places()
        movie = self._open()
        timeline = _Timeline(self._rate, self._given_rate, movie.tick, places[0] if places else None)
        converter = Converter()
        self.repaired_stamps, self.after = 0, ()
        number = given = 0
        try:
            frames = whole_images(movie.frames())
            while movie in self._open_now:  # until close()
                frame = self._next(frames, number, timeline)
                if frame is None:
                    self._tell(movie, given, len(places), timeline.seconds)
                    return
                number = _place(places, shown_at(frame), number)
                seconds = timeline.step(number, shown_at(frame))
                self.repaired_stamps = timeline.repaired
                image = converter.image(frame)
                del frame  # release its memory for the next frame
                yield ViewFrame(self.camera, self._stamp(number, seconds), number, image)
                del image
                number, given = number + 1, given + 1
        finally:
            self._release(movie)

    def close(self) -> None:
        """Close the file; running iterations end."""
        for movie in list(self._open_now):
            self._release(movie)

    def __enter__(self) -> VideoSource:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _open(self, look: bool = False) -> Movie:
        if not self.path.is_file():
            state = "is a folder" if self.path.is_dir() else "does not exist"
            raise DataError(f"{self._what} {state}; check the path")
        if self.path.stat().st_size == 0:
            raise DataError(f"{self._what} is empty (0 bytes); record or copy it again")
        cut = "" if self._skip else find_cut(self.path)
        if cut:
            raise DataError(f"{self._what} is cut off: {cut}; copy or record it again, or {SKIP}")
        movie = Movie(
            self.path, self._what, threads=not look, hardware=self._hardware, skip_damaged=self._skip
        )
        self._open_now.append(movie)
        return movie

    def _release(self, movie: Movie) -> None:
        movie.close()
        if movie in self._open_now:
            self._open_now.remove(movie)

    def _look(self, movie: Movie) -> tuple[float, Fraction, str]:
        """Read size, orientation and frame count from a file and its first frame.

        Returns:
            frame rate in Hz, 0 = unknown; time of the first frame since the recording began, s; its timecode.
        """
        first = next(movie.frames(), None)
        if first is None:
            raise DataError(f"{self._what} has no frame that can be decoded; record or copy it again")
        height, width = Converter().image(first).shape[:2]
        self.image_size = (width, height)
        begin = (shown_at(first) if movie.has_zero else None) or Fraction(0)
        self.frame_count = movie.frame_count(begin)
        self._tells_end = movie.tells_end
        self.has_sound = any(movie.sound_tracks)
        self.sound_track = movie.sound_tracks.index(True) if self.has_sound else 0
        orientation = orientation_of(first)
        silent = [str(k + 1) for k, known in enumerate(movie.sound_tracks) if not known]
        told = [
            str(orientation) if orientation != UPRIGHT else "",
            "images are interlaced: each is made of its first field" if first.interlaced_frame else "",
            f"sound track {', '.join(silent)} has no decoder and is left out" if silent else "",
        ]
        self.notices = tuple(filter(None, told))
        return movie.frame_rate, begin, movie.timecode

    def _lateness(self, begin: Fraction) -> Fraction:
        """Return the time of the first frame since the recording began, s; 0 if below one period.

        Args:
            begin: presentation time of the first frame, s. Without an edit list it includes the reordering
                delay.
        """
        periods = begin * self._rate + NEARLY
        if periods < 1:
            return Fraction(0)
        movie = self._open(look=True)
        try:
            delay = 0 if has_edits(self.path) else movie.reordering()
            nearest = round(begin * self._rate) / self._rate
            exact = nearest if abs(begin - nearest) <= rounding(begin, movie.tick) else begin
        finally:
            self._release(movie)
        return exact if periods >= delay + 1 else Fraction(0)

    def _places(self) -> list[Fraction]:
        """Return the times of all frames (s) if damaged frames are skipped; else []."""
        if not self._skip:
            return []
        movie = self._open(look=True)
        try:
            return movie.frame_times()
        except DataError:  # the file cannot be read beyond the damage
            return []
        finally:
            self._release(movie)

    def _next(self, frames: Iterator[VideoFrame], number: int, timeline: _Timeline) -> VideoFrame | None:
        """Return the next frame; None at the end.

        Raises:
            DataError: if frames are missing or the file cannot be read further, unless damage is allowed.
        """
        try:
            frame = next(frames, None)
        except DataError:
            if self._skip:
                return None
            self._check_end(number, timeline.seconds)
            raise
        if frame is None and not self._skip:
            self._check_end(number, timeline.seconds)
        return frame

    def _stamp(self, number: int, seconds: Fraction) -> int:
        if self._stamps is None:
            return self.start_ns + round(seconds * SECOND_NS)
        if number >= len(self._stamps):
            raise DataError(f"{self._what} has more frames than the {len(self._stamps)} stamps given")
        return self._stamps[number]

    def _sound_end(self) -> Fraction:
        """Return the end of the file's last sound, s: the stated duration may be that of the sound."""
        movie = self._open(look=True)
        try:
            return movie.sound_end
        finally:
            self._release(movie)

    def _missing(self, decoded: int, last: Fraction) -> int:
        """Return the number of frames that the file states but that were not decoded.

        Args:
            last: presentation time of the last frame, s since the first.
        """
        promised = self.frame_count
        if promised is None or decoded >= promised:
            return 0
        missing, hidden = promised - decoded, hidden_seconds(self.path)
        if hidden == math.inf:
            # the stated count is only duration times rate: compare times, because rates may vary
            told = promised / self._rate
            slack = SLACK_S if self._tells_end else max(Fraction(1), told / 50)
            absent = told - last - 1 / self._rate
            return 0 if absent <= slack or told - self._sound_end() <= slack else missing
        return 0 if missing <= hidden * self._own_rate + 0.5 else missing

    def _check_end(self, decoded: int, last: Fraction) -> None:
        """Check that as many frames were decoded as the file states.

        Raises:
            DataError: if some are missing.
        """
        if self._missing(decoded, last):
            raise DataError(
                f"{self._what}: only {decoded} of {self.frame_count} frames could be decoded; "
                f"the file is damaged or cut off, copy or record it again, or {SKIP}"
            )

    def _tell(self, movie: Movie, given: int, stored: int, last: Fraction) -> None:
        """Set `after` to notices about damaged frames and repaired times.

        Args:
            given: number of frames yielded.
            stored: number of frames in the file, as far as known.
            last: presentation time of the last frame, s since the first.

        Raises:
            DataError: if some frames could not be decoded, and damage is not allowed.
        """
        lost = max(stored - given, movie.lost + movie.left_out)
        lost = max(lost, self._missing(given, last) if self._skip else 0)
        if lost and not self._skip:
            raise DataError(
                f"{self._what}: {lost} frames could not be decoded; the file is damaged, copy or record it "
                f"again, or {SKIP}"
            )
        told = [
            ("damaged", lost, f"of {given + lost} frames are damaged and left out"),
            ("patched", 0 if self._skip else movie.patched, f"frames are damaged in parts; {SKIP}"),
            (
                "repaired",
                self.repaired_stamps,
                "frames have times that do not increase; each comes one period after the previous frame",
            ),
        ]
        self.after = tuple(
            Notice(
                f"source.{code}",
                "warning",
                f"video {self.path.name}: {count} {text}",
                {"device": self.camera},
            )
            for code, count, text in told
            if count
        )


def _place(places: Sequence[Fraction], shown: Fraction | None, number: int) -> int:
    """Return the index of a time among those of all frames; `number` if it is not among them."""
    if shown is None:
        return number
    at = bisect.bisect_left(places, shown)
    return at if at < len(places) and places[at] == shown and at >= number else number


class _Timeline:
    """Seconds since the first frame, from the container's times.

    Args:
        first: time of the first frame, s; None = that of the first step.
    """

    def __init__(self, rate: Fraction, ignore_container: bool, tick: Fraction, first: Fraction | None = None):
        self.rate = rate
        self.seconds = Fraction(-1)
        self.repaired = 0
        self._ignore = ignore_container
        self._tick = tick
        self._first = first
        self._on_grid = True

    def step(self, number: int, container: Fraction | None) -> Fraction:
        """Return the time of frame `number`, s since the first.

        Args:
            container: its presentation time in the file, s; None = unknown.
        """
        if self._first is None:
            self._first = container or Fraction(0)
        if self._ignore:
            self.seconds = number / self.rate
        elif number == 0:
            self.seconds = Fraction(0)
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
