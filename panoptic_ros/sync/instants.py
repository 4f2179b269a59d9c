"""Define the instants on the master time line for which sets are formed."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence

import numpy as np

from panoptic_ros.stamps.rates import exact_rate
from panoptic_ros.sync.config import SyncConfig

SECOND = 1_000_000_000
SAME_RATE = 0.02  # maximum relative difference of the periods of cameras with equal rate
STEPS = 60  # maximum number of frame steps whose mean is the period
LEAST_STEPS = 3  # minimum number of frame steps for a valid period
PULL = 0.3  # gain of the update of an instant by a frame of the master camera
FARTHEST = 0.25  # periods, limit of the innovation
PHASE_GAIN = 0.05  # gain of the update of a camera's phase relative to the master camera
ALIKE = 0.05  # periods; timestamps closer than this come from one trigger


class PeriodEstimate:
    """Period of a camera, from the timestamps of its newest frames alone."""

    def __init__(self) -> None:
        self._steps: deque[int] = deque(maxlen=STEPS)
        self.newest: int | None = None

    def add(self, stamp_ns: int) -> float:
        """Add the next timestamp; return the period so far in ns, 0 while it is uncertain."""
        if self.newest is not None:
            self._steps.append(stamp_ns - self.newest)
        self.newest = stamp_ns
        return self.period if len(self._steps) >= LEAST_STEPS else 0.0

    @property
    def period(self) -> float:
        """Return the mean (ns) of the frame steps near their lower median.

        Drops and late timestamps hardly affect it.
        """
        if not self._steps:
            return 0.0
        steps = np.array(self._steps, float)
        middle = float(np.sort(steps)[(len(steps) - 1) // 2])
        return float(steps[np.abs(steps - middle) <= 0.4 * middle].mean())


class InstantGrid:
    """Instants at whole multiples of a period on the master clock."""

    def __init__(self, config: SyncConfig):
        self._rate = exact_rate(config.rate_hz)
        self._phase = round(config.phase_s * SECOND)
        self.period = float(SECOND / self._rate)

    def nearest(self, stamp_ns: int) -> int:
        """Return the instant nearest to a timestamp."""
        return self._at(round((stamp_ns - self._phase) * self._rate / SECOND))

    def after(self, instant: int) -> int:
        """Return the next instant."""
        return self._at(round((instant - self._phase) * self._rate / SECOND) + 1)

    def settle(self, instant: int, frames: Mapping[str, int]) -> int:
        """Return the instant unchanged, as a fixed grid does not depend on frames."""
        return instant

    def stamp_of(self, instant: int, stamps: Sequence[int]) -> int:
        """Return the timestamp of the set: the instant itself."""
        return instant

    def _at(self, count: int) -> int:
        return self._phase + round(count * SECOND / self._rate)


class CameraInstants:
    """Instants that follow the frames of one camera: predicted, and updated by each new frame.

    Late timestamps move the instants little, and dropped frames leave no gap. While the master camera has no
    frame, cameras of the same rate replace it. Their phase relative to the master camera is estimated before.
    """

    def __init__(self, master: str, period: float, same_rate: frozenset[str]):
        self.master = master
        self.period = period
        self._same_rate = same_rate - {master}
        self._phases: dict[str, float] = {}
        self._last: int | None = None

    def nearest(self, stamp_ns: int) -> int:
        """Return the instant nearest to a timestamp."""
        if self._last is None:
            return stamp_ns
        return self._last + round(round((stamp_ns - self._last) / self.period) * self.period)

    def after(self, instant: int) -> int:
        """Return the next instant."""
        return instant + round(self.period)

    def settle(self, instant: int, frames: Mapping[str, int]) -> int:
        """Return the instant, updated by the frames chosen for it."""
        if self.master in frames:
            error = float(frames[self.master] - instant)
        else:
            errors = [frames[c] - instant - self._phases[c] for c in self._phases if c in frames]
            error = float(np.median(errors)) if errors else 0.0
        limit = FARTHEST * self.period
        settled = instant + round(PULL * min(max(error, -limit), limit))
        if self.master in frames:
            for camera in self._same_rate & frames.keys():
                phase = float(frames[camera] - settled)
                known = self._phases.get(camera, phase)
                self._phases[camera] = known + PHASE_GAIN * (phase - known)
        self._last = settled
        return settled

    def stamp_of(self, instant: int, stamps: Sequence[int]) -> int:
        """Return the timestamp of the set: the instant, or the median timestamp of triggered cameras."""
        if not stamps:
            return instant
        middle = sorted(stamps)[(len(stamps) - 1) // 2]
        farthest = max(abs(other - instant) for other in (min(stamps), middle, max(stamps)))
        return middle if farthest <= ALIKE * self.period else instant


Instants = InstantGrid | CameraInstants


def choose_master(periods: Mapping[str, float], wanted: str) -> tuple[str, float, frozenset[str]]:
    """Return the camera that sets follow, its period (ns), and all cameras with its frame rate.

    Args:
        periods: (ns) by camera, in rig order; 0 = unknown.
        wanted: name of a camera, or "auto".
    """
    known = {name: period for name, period in periods.items() if period > 0.0}
    fastest = min(known.values(), default=0.0)
    master = wanted
    if wanted not in periods:
        master = next((n for n, p in known.items() if p <= fastest * (1 + SAME_RATE)), next(iter(periods)))
    period = known.get(master, fastest)
    same = frozenset(n for n, p in known.items() if abs(p - period) <= SAME_RATE * period)
    return master, period, same
