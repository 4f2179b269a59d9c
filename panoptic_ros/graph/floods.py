"""Live: whether a topic brings more than a node can read without harm to its other topics."""

from __future__ import annotations

from dataclasses import dataclass

SECOND = 1_000_000_000
MOST_BAD = 60  # messages a second: a camera may send nothing else, at its rate
MOST_MESSAGES = 600  # a second
MOST_BYTES = 24_000_000  # a second: 60 Hz with dense score maps
PAUSE_NS = SECOND
LONGEST_PAUSE_NS = 8 * SECOND


@dataclass
class FloodGuard:
    """Counts what comes in one second; times are of a monotonic clock, ns.

    Args:
        most_messages, most_bytes: a second; 0: not limited.
    """

    most_messages: int = MOST_MESSAGES
    most_bytes: int = MOST_BYTES
    _begun_ns: int = -SECOND
    _messages: int = 0
    _bytes: int = 0
    _bad: int = 0
    _pause_ns: int = PAUSE_NS
    _paused_until_ns: int = -10 * SECOND

    def came(self, now_ns: int, size: int, bad: int) -> str:
        """A message has come; why the topic is to be left alone for `pause_ns`, "" if it is not.

        Args:
            size: bytes. bad: how many messages of the topic were refused so far.
        """
        if now_ns - self._begun_ns >= SECOND:
            self._begun_ns, self._messages, self._bytes = now_ns, 0, 0
            self._bad = bad
        self._messages += 1
        self._bytes += size
        if bad - self._bad > MOST_BAD:
            return f"more than {MOST_BAD} bad messages a second"
        if self.most_messages and self._messages > self.most_messages:
            return f"more than {self.most_messages} messages a second"
        if self.most_bytes and self._bytes > self.most_bytes:
            return f"more than {self.most_bytes / 1e6:g} MB a second"
        return ""

    def pause(self, now_ns: int) -> int:
        """Leave the topic alone from now on; for how long, ns. The next pause is longer if it comes soon."""
        soon = now_ns - self._paused_until_ns < 2 * SECOND
        self._pause_ns = min(2 * self._pause_ns, LONGEST_PAUSE_NS) if soon else PAUSE_NS
        self._paused_until_ns = now_ns + self._pause_ns
        self._begun_ns = -SECOND
        return self._pause_ns
