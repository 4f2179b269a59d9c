"""Message statistics of one topic: rate, age of the newest message, and losses before arrival.

`FloodGuard` detects live topics that send more than a node can read without harm to its other topics.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

SECOND = 1_000_000_000
SILENT_PERIODS = 3  # message periods without a message, after which a topic is silent
LEAST_SILENCE_NS = SECOND  # 1 s; a topic is not silent before this time
RECENT = 64  # messages over which rate and latency are computed
FEW = 3  # messages needed to compute a share
MOST_PUBLISHERS = 4  # publishers that are tracked per topic
MOST_LOST = 3600  # messages; a larger gap is a restarted publisher or an invalid number


class ArrivalCounters:
    """Message counters of one topic, bounded in memory. Times are of one monotonic clock, ns.

    Args:
        topic: Key of `TOPICS`.
        owner: Camera, sensor or device. "" for topics of the graph.
        name: Full name of the topic.
        regular: Whether messages come at a rate, so that their absence is an outage.
        since_ns: Time from which messages are expected.
    """

    def __init__(self, topic: str, owner: str, name: str, regular: bool, since_ns: int):
        self.topic, self.owner, self.name, self.regular = topic, owner, name, regular
        self.taken = 0
        self.lost = 0  # messages lost between publisher and here
        self.left_out = 0  # record numbers that the publisher never sent
        self.bad = 0
        self.cpu_ns = 0  # processor time of reading the topic, if the node reads it itself
        self.paused = ""  # reason if the topic is paused, else ""
        self._since_ns = since_ns
        self._newest_ns: int | None = None
        self._publishers = _Publishers()
        self._number: int | None = None
        self._lost_before = 0  # messages lost since the newest record with a number
        self._intervals: deque[int] = deque(maxlen=RECENT)
        self._latencies: deque[int] = deque(maxlen=RECENT)
        self._missing: deque[int] = deque(maxlen=RECENT)

    @property
    def title(self) -> str:
        """Return the owner and the topic, e.g. "left detections"."""
        return f"{self.owner} {self.topic}".strip()

    def came(self, now_ns: int, sequence: int | None = None, latency_ns: int | None = None) -> None:
        """Count a message.

        Args:
            sequence: Number that the publisher's middleware gave it, from 1.
            latency_ns: Time since its timestamp.
        """
        self.taken += 1
        if self._newest_ns is not None:
            self._intervals.append(now_ns - self._newest_ns)
        self._newest_ns = now_ns
        if sequence is not None:
            missing = self._publishers.missing_before(sequence)
            self.lost += missing
            self._lost_before += missing
            self._missing.append(missing)
        if latency_ns is not None:
            self._latencies.append(latency_ns)

    def lost_share(self) -> float:
        """Return the share of recent messages that were lost; 0 while it is unknown."""
        lost = sum(self._missing)
        return lost / (lost + len(self._missing)) if len(self._missing) >= FEW else 0.0

    def numbered(self, number: int) -> int:
        """Take the number of a record; return how many numbers before it were never sent."""
        before, self._number = self._number, number
        gap = 0 if before is None else number - before - 1
        lost, self._lost_before = self._lost_before, 0
        missing = gap - lost if 0 < gap <= MOST_LOST else 0
        self.left_out += max(0, missing)
        return max(0, missing)

    def period_ns(self) -> int:
        """Return the median time between messages, ns; 0 while it is unknown."""
        return int(np.median(self._intervals)) if self._intervals else 0

    def age_ns(self, now_ns: int) -> int:
        """Return the age of the newest message, ns; before the first one, the time since the start."""
        return now_ns - (self._since_ns if self._newest_ns is None else self._newest_ns)

    def is_silent(self, now_ns: int) -> bool:
        """Return whether messages are overdue."""
        age = self.age_ns(now_ns)
        return self.regular and age > LEAST_SILENCE_NS and age > SILENT_PERIODS * self.period_ns()

    def rate_hz(self, now_ns: int) -> float:
        """Return the recent message rate, Hz; it decreases while no messages come."""
        if not self._intervals:
            return 0.0
        mean = sum(self._intervals) / len(self._intervals)
        return SECOND / max(1.0, mean, self.age_ns(now_ns) - mean)

    def values(self, now_ns: int) -> dict[str, str]:
        """Return all counters as text, for /diagnostics."""
        p50, p99 = _percentiles_ms(self._latencies)
        age = "nan" if self._newest_ns is None else f"{self.age_ns(now_ns) / SECOND:.2f}"
        return {
            "topic": self.name,
            "taken": str(self.taken),
            "rate_hz": f"{self.rate_hz(now_ns):.2f}",
            "age_s": age,
            "period_ms": f"{self.period_ns() * 1e-6:.1f}",
            "latency_p50_ms": p50,
            "latency_p99_ms": p99,
            "lost": str(self.lost),
            "left_out": str(self.left_out),
            "bad": str(self.bad),
            **({"cpu_s": f"{1e-9 * self.cpu_ns:.3f}"} if self.cpu_ns else {}),
        }

    def trouble(self, now_ns: int) -> str:
        """Return a description of the problem; "" if there is none."""
        if self.paused:
            return self.paused
        if not self.is_silent(now_ns):
            return ""
        age = self.age_ns(now_ns) / SECOND
        if self._newest_ns is None:
            return f"no {self.title} was received yet, {age:.1f} s after the start"
        return f"no {self.title} for {age:.1f} s"


class _Publishers:
    """Sequence numbers of the publishers of a topic, which the middleware does not distinguish.

    A message is assigned to the publisher whose last number is nearest below its own.
    """

    def __init__(self) -> None:
        self._newest: list[int] = []  # last number of each publisher; the most recent publisher is last

    def missing_before(self, sequence: int) -> int:
        """Return how many messages of its publisher are missing before this one."""
        if self._newest and self._newest[-1] == sequence - 1:  # the usual case
            self._newest[-1] = sequence
            return 0
        gaps = [(sequence - newest - 1, newest) for newest in self._newest]
        gap, newest = min(((g, n) for g, n in gaps if 0 <= g <= MOST_LOST), default=(0, -1))
        self._newest = [*(n for n in self._newest if n != newest), sequence][-MOST_PUBLISHERS:]
        return gap


def _percentiles_ms(values: deque[int]) -> tuple[str, str]:
    if not values:
        return "nan", "nan"
    p50, p99 = np.percentile(np.array(values), (50, 99)) * 1e-6
    return f"{p50:.2f}", f"{p99:.2f}"


MOST_BAD = 60  # bad messages per second; a camera may send only bad ones at its frame rate
MOST_MESSAGES = 600  # messages per second
MOST_BYTES = 24_000_000  # bytes per second: 60 Hz with dense score maps
PAUSE_NS = SECOND
LONGEST_PAUSE_NS = 8 * SECOND


@dataclass
class FloodGuard:
    """Detector of message floods: it counts messages and bytes per second.

    Times are of a monotonic clock, ns.

    Args:
        most_messages, most_bytes: Limits per second. 0: no limit.
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
        """Count a message; return the reason to pause the topic, "" if there is none.

        Args:
            size: Message size, bytes.
            bad: Number of messages of the topic that were refused so far.
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
        """Begin a pause of the topic and return its duration, ns.

        The duration doubles if the previous pause ended less than 2 s ago.
        """
        soon = now_ns - self._paused_until_ns < 2 * SECOND
        self._pause_ns = min(2 * self._pause_ns, LONGEST_PAUSE_NS) if soon else PAUSE_NS
        self._paused_until_ns = now_ns + self._pause_ns
        self._begun_ns = -SECOND
        return self._pause_ns
