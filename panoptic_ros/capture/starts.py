"""Find the relative starts of several cameras' recordings from timecode, late starts and image numbers."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Protocol

from panoptic_ros.capture.source import SECOND_NS, exact_rate

DAY_S = 86_400
MOST_SHOWN = 4  # labels listed in a notice
OVERRIDE = "timestamps.csv or --frame-rate overrides it"


@dataclass(frozen=True)
class TimecodeLabel:
    """A timecode label.

    Args:
        text: HH:MM:SS:FF.
        seconds: since 00:00:00:00, in real time.
    """

    text: str
    seconds: Fraction


class RecordingStart(Protocol):
    """Recorded source with the start information of its file.

    Args:
        late: s from the beginning of the recording to the first frame, as the file states.
        label: timecode of the first frame.
        first: number of the first image; None = images are not numbered.
        step: difference between the numbers of successive images.
    """

    camera: str
    frame_rate: float
    frame_count: int | None
    late: Fraction
    label: TimecodeLabel | None
    first: int | None
    step: int


def read_label(
    text: str, rate: Fraction, counted: tuple[int, Fraction] | None = None
) -> TimecodeLabel | None:
    """Parse a timecode; None if the text is invalid.

    Args:
        text: HH:MM:SS:FF, or HH:MM:SS;FF for drop-frame (SMPTE 12M). Drop-frame omits labels 0 and 1 of 30 in
            each minute, except in every tenth.
        rate: frame rate, Hz.
        counted: labels per second and their true rate, Hz, if the file states them.
    """
    words = re.fullmatch(r"(\d{1,2}):(\d{2}):(\d{2})([:;.,])(\d{2,3})", text)
    if words is None or rate <= 0:
        return None
    nominal, exact = counted or (round(rate) or 1, rate)
    hours, minutes, seconds, frames = (int(words[k]) for k in (1, 2, 3, 5))
    if hours >= 24 or minutes >= 60 or seconds >= 60 or frames >= nominal:
        return None
    minutes += 60 * hours
    count = (60 * minutes + seconds) * nominal + frames
    if words[4] != ":" and nominal % 30 == 0:
        count -= nominal // 15 * (minutes - minutes // 10)
    return TimecodeLabel(text, count / exact)


def find_starts(sources: Sequence[RecordingStart]) -> tuple[dict[str, int], tuple[str, ...]]:
    """Return the start of each recording by camera, ns after the earliest, and notices.

    Timecode is used if all recordings have one and it makes them overlap. Otherwise late starts and image
    numbers are used if they make the recordings overlap. Otherwise all begin together, and the result is
    empty.
    """
    notices = []
    begins = None
    if any(source.label for source in sources):
        begins, line = _by_timecode(sources)
        notices.append(line)
    if begins is None:
        begins, lines = _by_files(sources)
        notices += lines
    first = min(begins.values(), default=Fraction(0))
    starts = {name: round((begin - first) * SECOND_NS) for name, begin in begins.items()}
    return (starts if any(starts.values()) else {}), tuple(notices)


def _by_timecode(sources: Sequence[RecordingStart]) -> tuple[dict[str, Fraction] | None, str]:
    labels = {source.camera: source.label for source in sources if source.label is not None}
    by_text: dict[str, list[str]] = {}
    for name, label in labels.items():
        by_text.setdefault(label.text, []).append(name)
    said = ", ".join(f"{text} ({', '.join(names)})" for text, names in list(by_text.items())[:MOST_SHOWN])
    said += ", ..." if len(by_text) > MOST_SHOWN else ""
    lacking = [source.camera for source in sources if source.label is None]
    if lacking:
        return None, f"timecode of the first frames, {said}, is not used: {', '.join(lacking)} have none"
    if len(by_text) == 1:
        return None, f"the timecode of all first frames is {said}"
    zero = next(iter(labels.values())).seconds
    begins = {name: _within_day(label.seconds - zero) for name, label in labels.items()}
    if not _overlap(sources, begins):
        return None, f"timecode of the first frames, {said}, is not used: the recordings would never overlap"
    return begins, f"recordings are aligned by the timecode of their first frames: {said}; {OVERRIDE}"


def _within_day(seconds: Fraction) -> Fraction:
    """Return a difference of two times of day in s, wrapped to -12 h .. 12 h."""
    return (seconds + DAY_S // 2) % DAY_S - DAY_S // 2


def _by_files(sources: Sequence[RecordingStart]) -> tuple[dict[str, Fraction], list[str]]:
    numbers = {s.camera: s.first for s in sources if s.first is not None}
    least = min(numbers.values(), default=0)
    begins = {
        source.camera: source.late
        if source.first is None
        else Fraction(source.first - least, source.step) / exact_rate(source.frame_rate, source.camera)
        for source in sources
    }
    first = min(begins.values(), default=Fraction(0))
    late = {name: begin - first for name, begin in begins.items() if begin > first}
    said = [
        f"camera {name} begins {float(begin):.6g} s after the first, as "
        + (f"its images are numbered from {numbers[name]} on" if name in numbers else "its file states")
        for name, begin in late.items()
    ]
    if not _overlap(sources, begins):
        return {}, [
            f"{line}; but then the recordings would never overlap, so all are assumed to begin together"
            for line in said
        ]
    return begins, [f"{line}; {OVERRIDE}" for line in said]


def _overlap(sources: Sequence[RecordingStart], begins: Mapping[str, Fraction]) -> bool:
    """Return whether the recordings have no gap: at any time from first to last frame some camera records."""
    spans = sorted(
        (begins[s.camera], begins[s.camera] + Fraction(s.frame_count or 0) / Fraction(s.frame_rate))
        for s in sources
    )
    end = spans[0][1] if spans else Fraction(0)
    for begin, own_end in spans:
        if begin > end:
            return False
        end = max(end, own_end)
    return True
