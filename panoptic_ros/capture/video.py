"""Video files as sources of frames: every frame once, upright, at its presentation time."""

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
from panoptic_ros.capture.starts import Label, read_label
from panoptic_ros.capture.upright import UPRIGHT, Converter, orientation_of, whole_images
from panoptic_ros.domain import ViewFrame
from panoptic_ros.errors import DataError
from panoptic_ros.stage import Notice

NEARLY = Fraction(1, 20)  # periods, by which files round times
SLACK_S = Fraction(1, 4)  # between the end that a track states and that of its last frame
SKIP = "--skip-damaged leaves out what is damaged"


class VideoSource:
    """The frames of a video file. Iterating starts at the first frame every time.

    Images are upright: they are turned and mirrored as the file's display matrix says, so that a phone's
    portrait video is portrait here and `image_size` is the size after turning. Interlaced frames are made
    of their first field. `notices` tell of both.

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
        start_ns: stamp of the first frame, ns; an attribute, for what is found out later.
        frame_rate: Hz, in place of the file's own times.
        stamps: ns, one per frame, in place of all others.
        hardware: that decodes, see `Movie`.
        skip_damaged: leave out frames that are damaged, in place of complaining; see `Movie`.

    Attributes:
        late: s from the beginning of the recording to the first frame, as the file says; 0 unless it is a
            frame period or more.
        label: the timecode of the first frame, if there is one.
        notices: what is done to images, without the camera.
        after: what is known after the last frame.

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
        skip_damaged: bool = False,
    ):
        self.camera = camera
        self._hardware, self._skip = hardware, skip_damaged
        self.path = Path(path)
        self.repaired_stamps = 0
        self.notices: tuple[str, ...] = ()
        self.after: tuple[Notice, ...] = ()
        self.late = Fraction(0)
        self.label: Label | None = None
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
            lack = "does not say its frame rate" if timed else "is a raw stream without times of its frames"
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
                del frame  # its memory serves the next one
                yield ViewFrame(self.camera, self._stamp(number, seconds), number, image)
                del image
                number, given = number + 1, given + 1
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
        """Take size, marks and count from a file and its first frame.

        Returns:
            its frame rate in Hz, 0 = not known; when it is shown since the recording began, s; its timecode.
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
        """Return the time of the first frame since the recording began, s; 0 where it is within a period.

        Args:
            begin: when it is shown, s. Files without an edit list count the delay of reordering in.
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
        """Return the times of all frames, s, where damaged ones are left out; else nothing."""
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
        """Return the next frame; None at the end, if no frame is missing or damage is allowed."""
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
        """Where the last sound of the file ends, s: it may be what lasts as long as the file says."""
        movie = self._open(look=True)
        try:
            return movie.sound_end
        finally:
            self._release(movie)

    def _missing(self, decoded: int, last: Fraction) -> int:
        """Return the number of frames that the file promised and that did not come.

        Args:
            last: when the last one is shown, s since the first.
        """
        promised = self.frame_count
        if promised is None or decoded >= promised:
            return 0
        missing, hidden = promised - decoded, hidden_seconds(self.path)
        if hidden == math.inf:
            # the count is no more than duration times rate: compare times, as rates may vary
            told = promised / self._rate
            slack = SLACK_S if self._tells_end else max(Fraction(1), told / 50)
            absent = told - last - 1 / self._rate
            return 0 if absent <= slack or told - self._sound_end() <= slack else missing
        return 0 if missing <= hidden * self._own_rate + 0.5 else missing

    def _check_end(self, decoded: int, last: Fraction) -> None:
        """Complain if the file promised more than could be decoded."""
        if self._missing(decoded, last):
            raise DataError(
                f"{self._what}: only {decoded} of {self.frame_count} frames could be decoded; "
                f"the file is damaged or cut off, copy or record it again, or {SKIP}"
            )

    def _tell(self, movie: Movie, given: int, stored: int, last: Fraction) -> None:
        """Set `after` to notices about damaged frames and repaired times.

        Args:
            given: frames. stored: frames of the file, as far as they are known.
            last: when the last frame is shown, s since the first.

        Raises:
            DataError: if some could not be decoded, and that is not allowed.
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
                "frames have no times that increase; each comes a period after the one before",
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
    """Return the place of a time among those of all frames; `number` if it is not among them."""
    if shown is None:
        return number
    at = bisect.bisect_left(places, shown)
    return at if at < len(places) and places[at] == shown and at >= number else number


class _Timeline:
    """Seconds since the first frame, from what the container says.

    Args:
        first: when that is shown; None = what the first step says.
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
        """Time of frame `number`; `container` is its presentation time in the file, s, None = unknown."""
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
