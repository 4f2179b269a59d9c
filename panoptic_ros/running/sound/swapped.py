"""Whether the channels of a recording carry each other's timecode.

Two things tell. Cameras take whole numbers of frames per frame of their timecode, or the other way round, so
25 Hz cameras are not on the clock of a 29.97 Hz timecode. And cameras are stamped with times that their
timecode shows, not with those of the other one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations, pairwise

from panoptic_ros.clocks.timeline import day_ns
from panoptic_ros.domain import TimecodeReading
from panoptic_ros.errors import DataError

WHOLE = 0.02  # of a number that a ratio may differ from it
NEARER_NS = 1_000_000_000  # by which stamps are nearer to the other timecode than to their own

Readings = Mapping[tuple[str, str], TimecodeReading]


def check_swapped(clocks: Mapping[str, str], words: Readings, stamps: Mapping[str, Sequence[int]]) -> None:
    """Whether two channels of one device fit the other's cameras only.

    Args:
        clocks: of cameras. words: first reading by device and clock.
        stamps: of each camera's frames, ns.

    Raises:
        DataError: naming the channels.
    """
    frames: dict[str, Sequence[int]] = {}
    for camera, clock in clocks.items():
        if len(stamps.get(camera, ())) > 1:
            frames.setdefault(clock, stamps[camera])
    for (one, a), (other, b) in combinations(words, 2):
        pair = [frames.get(a, ()), frames.get(b, ())]
        if one == other and all(pair) and _are_swapped(pair, [words[one, a], words[other, b]]):
            raise DataError(
                f"the channels of {one} seem to be swapped: cameras of clock {a} fit the timecode on the "
                f"channel of {b} ({words[other, b].timecode}), and those of {b} that of {a} "
                f"({words[one, a].timecode}); mend sound.yaml"
            )


def _are_swapped(frames: Sequence[Sequence[int]], words: Sequence[TimecodeReading]) -> bool:
    own, others = list(zip(frames, words)), list(zip(frames, words[::-1]))
    if not any(_fits(*pair) for pair in own) and all(_fits(*pair) for pair in others):
        return True
    nearest = min(_away_ns(*pair) for pair in own)
    alike = all(_fits(*pair) for pair in others)
    return alike and max(_away_ns(*pair) for pair in others) + NEARER_NS < nearest


def _fits(stamps: Sequence[int], word: TimecodeReading) -> bool:
    """Whether frames and timecode have rates of which one is a multiple of the other."""
    steps = sorted(after - before for before, after in pairwise(stamps))
    ratio = steps[len(steps) // 2] * 1e-9 * float(word.timecode.rate.exact)
    ratio = max(ratio, 1.0 / max(ratio, 1e-9))
    return abs(ratio - round(ratio)) <= WHOLE * ratio


def _away_ns(stamps: Sequence[int], word: TimecodeReading) -> int:
    """How far the first frame is from what the timecode showed first."""
    return abs(stamps[0] - day_ns(word.timecode))
