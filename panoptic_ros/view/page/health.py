"""How the live graph is: measured where messages arrive, as a slow browser would tell of silent cameras."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

WINDOW_S = 2.0  # rates are counted over this
PLAUSIBLE_S = 60.0  # stamps farther from the wall clock than this are of another clock


class Health:
    """Rates, ages and latency of what comes, and what nodes say of themselves."""

    def __init__(self) -> None:
        self._arrivals: dict[str, deque[float]] = {}
        self._latest: dict[str, float] = {}
        self._latencies: deque[float] = deque(maxlen=300)
        self.statuses: dict[str, Mapping[str, Any]] = {}  # by name, as on /diagnostics

    def arrived(self, name: str, now_s: float) -> None:
        """A message of a camera, or of the graph ("")."""
        times = self._arrivals.setdefault(name, deque())
        times.append(now_s)
        while times[0] < now_s - WINDOW_S:
            times.popleft()
        self._latest[name] = now_s

    def published(self, stamp_ns: int, wall_ns: int) -> None:
        """Skeletons of a stamp have come; what is no wall clock tells no latency."""
        latency = (wall_ns - stamp_ns) * 1e-9
        if 0.0 <= latency < PLAUSIBLE_S:
            self._latencies.append(latency)

    def document(self, cameras: Sequence[str], now_s: float) -> dict[str, Any]:
        """For JSON. Latency from capture to arrival, ms; ages in s, null before the first message."""
        latencies = sorted(self._latencies)
        return {
            "type": "health",
            "cameras": {name: self._of(name, now_s) for name in cameras},
            "skeletons": self._of("", now_s),
            "latency_ms": [1e3 * latencies[round(q * (len(latencies) - 1))] for q in (0.5, 0.99)]
            if latencies
            else None,
            "statuses": list(self.statuses.values()),
        }

    def _of(self, name: str, now_s: float) -> dict[str, Any]:
        recent = sum(time > now_s - WINDOW_S for time in self._arrivals.get(name, ()))
        age = now_s - self._latest[name] if name in self._latest else None
        return {"rate_hz": recent / WINDOW_S, "age_s": age}
