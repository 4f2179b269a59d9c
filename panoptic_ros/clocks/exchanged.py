"""Channels of a recorder that are exchanged while it runs: words of another clock than the channel's.

Two signs tell it. A word has another frame rate than all of its clock before: no generator changes it. Or a
word is off the line of its own clock and on that of another clock of the recorder, whose own channel has none
of its words any more. If it has, the generator was set to the time of the other: that is a jump.
"""

from __future__ import annotations

from collections.abc import Mapping

from panoptic_ros.clocks.timeline import day_length_ns, day_ns
from panoptic_ros.domain import ClockModel, TimecodeReading
from panoptic_ros.stage import Notice

SURE_WORDS = 25  # in a row: a clock keeps the frame rate of its timecode
NEAR_NS = 2_000_000  # between a word and a line that it is on; frames are ten times as long
LONG_NS = 500_000_000  # for which words of another clock come before that is told


class ExchangedChannels:
    """What the words of each channel were, to tell when they become another clock's."""

    def __init__(self) -> None:
        # by channel: frames per second of its words and how many came in a row; when the last word was on its
        # own line, and since when words are on another's, in ns of the count of samples
        self._counts: dict[str, list[int]] = {}
        self._on_line: dict[str, int] = {}
        self._off_since: dict[str, int] = {}
        self._told: set[str] = set()

    def owner(
        self,
        reading: TimecodeReading,
        sample_ns: int,
        lines: Mapping[str, ClockModel | None],
        shifts: Mapping[str, int],
    ) -> str | None:
        """Whose word it may be instead; "" = nobody knows whose. None: it is taken for its own clock's.

        Args:
            sample_ns: when it began, by the count of samples.
            lines: of the clocks that the recorder hears, from such times to those of the clock.
            shifts: by clock: what its time line adds to labels, ns.
        """
        channel = _channel(reading)
        if self._has_other_rate(reading, channel):
            return ""
        known = {clock: line for clock, line in lines.items() if line is not None}
        on = {c for c, line in known.items() if _is_on(reading, sample_ns, line, shifts[c])}
        if reading.clock in on or not on or reading.clock not in known:
            self._off_since.pop(channel, None)
            if reading.clock in on:
                self._on_line[channel] = sample_ns
            return None
        since = self._off_since.setdefault(channel, sample_ns)
        still = [c for c in on if self._on_line.get(f"{c} in {reading.device}", -1) > since]
        return None if still else min(on)

    def notices(self, reading: TimecodeReading, sample_ns: int, owner: str) -> tuple[Notice, ...]:
        """What a person should know, once for each channel."""
        channel = _channel(reading)
        if channel in self._told or (owner and sample_ns - self._off_since[channel] < LONG_NS):
            return ()
        self._told.add(channel)
        heard = f"the timecode of {reading.clock} that {reading.device} hears"
        if owner:
            what = f"{heard} goes on as that of {owner} did, {reading.timecode}"
            after = "are left out"
        else:
            what = (
                f"{heard} had {self._counts[channel][0]} frames per second, and has "
                f"{reading.timecode.rate.nominal} now"
            )
            after = "are left out; a clock that shall have another rate needs a new run"
        text = f"{what}: are channels swapped? Such words {after}"
        return (Notice("clocks.other_timecode", "warning", text, {"device": reading.device}),)

    def _has_other_rate(self, reading: TimecodeReading, channel: str) -> bool:
        frames = reading.timecode.rate.nominal
        known = self._counts.setdefault(channel, [frames, 0])
        if frames != known[0] and known[1] >= SURE_WORDS:
            return True
        known[1] = known[1] + 1 if frames == known[0] else 1
        known[0] = frames
        return False


def _channel(reading: TimecodeReading) -> str:
    return f"{reading.clock} in {reading.device}"


def _is_on(reading: TimecodeReading, sample_ns: int, line: ClockModel, shift_ns: int) -> bool:
    """Whether a word says what a line expects then, on any day."""
    day = day_length_ns(reading.timecode)
    miss = day_ns(reading.timecode) + shift_ns - line.master_from_device(sample_ns)[0]
    return abs((miss + day // 2) % day - day // 2) < NEAR_NS
