"""Detect channels of a recorder that are swapped while it runs: a channel carries words of another clock.

There are two signs. First, a word has a frame rate different from all earlier words of its clock, which no
generator changes. Second, a word is off the line of its own clock and on that of another clock of the
recorder. The other clock's own channel must then have no words on that line any more. If it still has, the
generator was set to the time of the other clock, which is a jump.
"""

from __future__ import annotations

from collections.abc import Mapping

from panoptic_ros.clocks.timeline import day_length_ns, day_ns
from panoptic_ros.domain import ClockModel, TimecodeReading
from panoptic_ros.stage import Notice

SURE_WORDS = 25  # consecutive words that fix the frame rate of a clock's timecode
NEAR_NS = 2_000_000  # ns, maximum distance of a word from its line; a frame is ten times as long
LONG_NS = 500_000_000  # ns of words of another clock before a notice is given


class ExchangedChannels:
    """History of the words of each channel, to detect when they belong to another clock."""

    def __init__(self) -> None:
        # All dictionaries are keyed by channel. `_counts`: frames per second, number of consecutive words at
        # that rate. `_on_line`: last time that a word was on its own line. `_off_since`: first time that a
        # word was on the line of another clock. Times are ns of the sample count.
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
        """Return the clock that a word may belong to instead of its own.

        Args:
            sample_ns: (ns) start of the word by the sample count.
            lines: lines of the clocks that the recorder receives, from sample times to times of the clock.
                None while a line is uncertain.
            shifts: (ns) by clock, the shift that its time line adds to labels.

        Returns: the name of the other clock; "" if it is unknown; None if the word belongs to its own clock.
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
        """Return the notice on swapped channels, once per channel."""
        channel = _channel(reading)
        if channel in self._told or (owner and sample_ns - self._off_since[channel] < LONG_NS):
            return ()
        self._told.add(channel)
        heard = f"the timecode of {reading.clock} at {reading.device}"
        if owner:
            what = f"{heard} continues that of {owner}, {reading.timecode}"
            after = "are left out"
        else:
            what = (
                f"{heard} had {self._counts[channel][0]} frames per second, and has "
                f"{reading.timecode.rate.nominal} now"
            )
            after = "are left out; another rate of a clock needs a new run"
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
    """Return whether a word matches the time that a line predicts, on any day."""
    day = day_length_ns(reading.timecode)
    miss = day_ns(reading.timecode) + shift_ns - line.master_from_device(sample_ns)[0]
    return abs((miss + day // 2) % day - day // 2) < NEAR_NS
