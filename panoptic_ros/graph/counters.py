"""Counts and durations that a node keeps about itself, bounded in memory."""
from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping

import numpy as np

from panoptic_ros.stage import Notice


class StageStatistics:
    """What went in and out of a stage, what was dropped and why, and how long a step takes."""

    def __init__(self) -> None:
        self.taken = 0
        self.given = 0
        self.dropped: Counter[str] = Counter()
        self.notices: Counter[str] = Counter()
        self._latest: dict[str, str] = {}  # texts of warnings by code
        self._durations: deque[int] = deque(maxlen=20000)  # ns

    def take(self, notice: Notice) -> None:
        """Count a notice, and remember the newest warning of its kind."""
        self.notices[notice.code] += 1
        if notice.severity != "info":
            self._latest[notice.code] = notice.text

    def add_duration(self, duration_ns: int) -> None:
        """Remember how long one step took."""
        self._durations.append(duration_ns)

    def percentiles_ms(self, *quantiles: float) -> tuple[float, ...]:
        """Durations at these quantiles (0..100), ms; NaN before the first step."""
        if not self._durations:
            return tuple(float("nan") for _ in quantiles)
        return tuple(float(q) * 1e-6 for q in np.percentile(np.array(self._durations), quantiles))

    def values(self) -> Mapping[str, str]:
        """All of it as text, for /diagnostics."""
        p50, p99 = self.percentiles_ms(50, 99)
        rows = {"taken": str(self.taken), "given": str(self.given)}
        rows |= {"step_p50_ms": f"{p50:.3f}", "step_p99_ms": f"{p99:.3f}"}
        rows |= {f"dropped.{cause}": str(n) for cause, n in sorted(self.dropped.items())}
        rows |= {f"notice.{code}": str(n) for code, n in sorted(self.notices.items())}
        rows |= {f"latest.{code}": text for code, text in sorted(self._latest.items())}
        return rows
