"""Counters and durations of a node, bounded in memory.

`DropLog` sums the drop counters of nodes over their restarts, after which a node counts from 0 again.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping

import numpy as np

from panoptic_ros.stage import Notice

KEPT = 20000  # most durations that are kept
RECENT = 1800  # most latencies that are kept: a minute at 30 Hz
OF = " "  # separator between the code of a warning and its device
MOST_DEVICES = 64  # devices per kind of warning whose newest warning is kept


class StageStatistics:
    """Counters of a stage: records in and out, drops by cause, notices, and step durations."""

    def __init__(self) -> None:
        self.taken = 0
        self.given = 0
        self.cpu_ns = 0
        self.dropped: Counter[str] = Counter()
        self.notices: Counter[str] = Counter()
        self._latest: dict[str, str] = {}  # texts of warnings, by code and by code and device
        self._told: dict[str, str] = {}  # texts of info notices, by code
        self._durations: deque[int] = deque(maxlen=KEPT)  # ns
        self._latencies: deque[int] = deque(maxlen=RECENT)  # ns

    def take(self, notice: Notice) -> None:
        """Count a notice, and keep the newest warning of its kind, also per device.

        Records that the notice reports as left out are counted as dropped with the cause "late".
        """
        self.notices[notice.code] += 1
        if "left_out" in notice.values:
            self.dropped["late"] += int(notice.values["left_out"])
        if notice.severity == "info":
            self._told[notice.code] = notice.text
            return
        self._latest[notice.code] = notice.text
        device = str(notice.values.get("device", ""))
        key = f"{notice.code}{OF}{device}"
        if device and (key in self._latest or self._devices(notice.code) < MOST_DEVICES):
            self._latest[key] = notice.text

    def _devices(self, code: str) -> int:
        return sum(key.startswith(f"{code}{OF}") for key in self._latest)

    def add_duration(self, duration_ns: int) -> None:
        """Add the duration of a step, ns."""
        self._durations.append(duration_ns)

    def add_latency(self, latency_ns: int) -> None:
        """Add the latency of an output record, ns since its timestamp."""
        self._latencies.append(latency_ns)

    @property
    def warned(self) -> Mapping[str, int]:
        """Return the number of notices for each kind of warning."""
        return {code: self.notices[code] for code in self._latest if OF not in code}

    def latest(self, code: str) -> str:
        """Return the newest text of a kind of warning."""
        return self._latest[code]

    def percentiles_ms(self, *quantiles: float) -> tuple[float, ...]:
        """Return step durations at these quantiles (0..100), ms; NaN before the first step."""
        return _percentiles_ms(self._durations, quantiles)

    def values(self) -> Mapping[str, str]:
        """Return all counters as text, for /diagnostics."""
        p50, p99 = self.percentiles_ms(50, 99)
        rows = {"taken": str(self.taken), "given": str(self.given)}
        rows |= {"cpu_s": f"{1e-9 * self.cpu_ns:.3f}"} if self.cpu_ns else {}
        rows |= {"step_p50_ms": f"{p50:.3f}", "step_p99_ms": f"{p99:.3f}"}
        if self._latencies:
            p50, p99 = _percentiles_ms(self._latencies, (50, 99))
            rows |= {"latency_p50_ms": f"{p50:.2f}", "latency_p99_ms": f"{p99:.2f}"}
        rows |= {f"dropped.{cause}": str(n) for cause, n in sorted(self.dropped.copy().items())}
        rows |= {f"notice.{code}": str(n) for code, n in sorted(self.notices.copy().items())}
        rows |= {f"latest.{code}": text for code, text in sorted(self._latest.copy().items())}
        rows |= {f"told.{code}": text for code, text in sorted(self._told.copy().items())}
        return rows


def _percentiles_ms(values: deque[int], quantiles: tuple[float, ...]) -> tuple[float, ...]:
    if not values:
        return tuple(float("nan") for _ in quantiles)
    return tuple(float(q) * 1e-6 for q in np.percentile(np.array(values.copy()), quantiles))


PREFIX = "dropped."  # prefix of keys on /diagnostics


class DropLog:
    """Log of dropped records, from the diagnostics of nodes. Times are of any clock, ns."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()  # by "<status>.<cause>"
        self.times: list[tuple[int, str]] = []  # (time, name) of each increase
        self._seen: dict[str, int] = {}  # counts of the current process of each node

    def heard(self, status: str, values: Mapping[str, str], now_ns: int) -> None:
        """Take a status of a node."""
        for key, value in values.items():
            if not key.startswith(PREFIX):
                continue
            name, count = f"{status}.{key.removeprefix(PREFIX)}", int(value)
            before = self._seen.get(name, 0)
            more = count - before if count >= before else count
            self._seen[name] = count
            if more:
                self.counts[name] += more
                self.times.append((now_ns, name))
