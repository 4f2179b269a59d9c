"""Limits of size and duration at which a recording continues in another bag."""

from __future__ import annotations

import re
from dataclasses import dataclass

from panoptic_ros.errors import UsageError

GB = 1_000_000_000
BYTES = {"MB": 1_000_000, "GB": GB}
SECONDS = {"s": 1.0, "m": 60.0, "h": 3600.0}


@dataclass(frozen=True)
class SplitLimits:
    """Limits at which a recording continues in another bag; 0 = no limit.

    Args:
        size: bytes of messages.
        seconds: between timestamps.
    """

    size: int = 0
    seconds: float = 0.0

    def is_over(self, size: int, seconds: float) -> bool:
        """Return whether a part of this size (bytes) and duration (s) has reached a limit."""
        return bool((self.size and size >= self.size) or (self.seconds and seconds >= self.seconds))


def split_of(text: str) -> SplitLimits:
    """Parse a split limit such as 90s, 30m, 1h, 500MB or 2GB.

    Raises:
        UsageError: if the text is neither a duration nor a size, or is zero.
    """
    found = re.fullmatch(rf"([0-9]*\.?[0-9]+)({'|'.join((*SECONDS, *BYTES))})", text)
    if found is None or not float(found[1]):
        raise UsageError(f"--split {text!r}: give a time or a size, e.g. 90s, 30m, 1h, 500MB, 2GB")
    amount, unit = float(found[1]), found[2]
    if unit in SECONDS:
        return SplitLimits(seconds=amount * SECONDS[unit])
    return SplitLimits(size=max(1, round(amount * BYTES[unit])))
