"""The master time line: at which instants sets are wanted."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from fractions import Fraction

import numpy as np

from panoptic_ros.sync.config import SyncConfig

SECOND = 1_000_000_000
SAME_RATE = 0.02  # cameras that differ by less have the same rate
STEPS = 60  # frame steps whose mean is the period
LEAST_STEPS = 3
PULL = 0.3  # gain of the update of instants by a frame of the master camera
FARTHEST = 0.25  # of a period: an innovation counts no more than that
PHASE_GAIN = 0.05  # of the update of a camera's phase against the master camera
ALIKE = 0.05  # of the period: stamps that differ by less are those of one trigger


class Pace:
    """The period of a camera from its newest frames, as a function of their stamps alone."""

    def __init__(self) -> None:
        self._steps: deque[int] = deque(maxlen=STEPS)
        self.newest: int | None = None

    def add(self, stamp_ns: int) -> float:
        """Take the next stamp; return the period so far in ns, 0 while it is not sure."""
        if self.newest is not None:
            self._steps.append(stamp_ns - self.newest)
        self.newest = stamp_ns
        return self.period if len(self._steps) >= LEAST_STEPS else 0.0

    @property
    def period(self) -> float:
        """The mean of the steps near the lower median, which drops and late stamps do not move; ns."""
        if not self._steps:
            return 0.0
        steps = np.array(self._steps, float)
        middle = float(np.sort(steps)[(len(steps) - 1) // 2])
        return float(steps[np.abs(steps - middle) <= 0.4 * middle].mean())


def exact_rate(rate_hz: float) -> Fraction:
    """The rate that is meant: 23.976, 29.97 and 59.94 are 24, 30 and 60 times 1000/1001."""
    television = Fraction(round(rate_hz * 1.001) * 1000, 1001)
    if abs(float(television) - rate_hz) < 1e-3:
        return television
    return Fraction(rate_hz).limit_denominator(10_000)


class Grid:
    """Instants at whole multiples of a period on the master clock."""

    def __init__(self, config: SyncConfig):
        self._rate = exact_rate(config.rate_hz)
        self._phase = round(config.phase_s * SECOND)
        self.period = float(SECOND / self._rate)

    def nearest(self, stamp_ns: int) -> int:
        """The instant nearest to a stamp."""
        return self._at(round((stamp_ns - self._phase) * self._rate / SECOND))

    def after(self, instant: int) -> int:
        """The next instant."""
        return self._at(round((instant - self._phase) * self._rate / SECOND) + 1)

    def settle(self, instant: int, frames: Mapping[str, int]) -> int:
        """The instant itself, whatever frames there are."""
        return instant

    def stamp_of(self, instant: int, stamps: Sequence[int]) -> int:
        """The stamp of the instant's set: the instant, whatever the stamps of its frames."""
        return instant

    def _at(self, count: int) -> int:
        return self._phase + round(count * SECOND / self._rate)


class CameraInstants:
    """Instants that follow the frames of one camera: predicted, and updated by every frame that comes.

    Late stamps move them little, and dropped frames leave no gap. While the master camera has no frame,
    cameras of the same rate stand in, with the phase that they have had against it.
    """

    def __init__(self, master: str, period: float, same_rate: frozenset[str]):
        self.master = master
        self.period = period
        self._same_rate = same_rate - {master}
        self._phases: dict[str, float] = {}
        self._last: int | None = None

    def nearest(self, stamp_ns: int) -> int:
        """The instant nearest to a stamp."""
        if self._last is None:
            return stamp_ns
        return self._last + round(round((stamp_ns - self._last) / self.period) * self.period)

    def after(self, instant: int) -> int:
        """The next instant."""
        return instant + round(self.period)

    def settle(self, instant: int, frames: Mapping[str, int]) -> int:
        """The instant, moved by the frames that were chosen for it."""
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
        """The stamp of the instant's set: the instant; for cameras with one trigger, the median of theirs."""
        if not stamps:
            return instant
        middle = sorted(stamps)[(len(stamps) - 1) // 2]
        farthest = max(abs(other - instant) for other in (min(stamps), middle, max(stamps)))
        return middle if farthest <= ALIKE * self.period else instant


Instants = Grid | CameraInstants


def choose_master(periods: Mapping[str, float], wanted: str) -> tuple[str, float, frozenset[str]]:
    """The camera that sets follow, its period, and all cameras of its rate.

    Args:
        periods: ns by camera, in the order of the rig; 0 = not known.
        wanted: a camera, or "auto".
    """
    known = {name: period for name, period in periods.items() if period > 0.0}
    fastest = min(known.values(), default=0.0)
    master = wanted
    if wanted not in periods:
        master = next((n for n, p in known.items() if p <= fastest * (1 + SAME_RATE)), next(iter(periods)))
    period = known.get(master, fastest)
    same = frozenset(n for n, p in known.items() if abs(p - period) <= SAME_RATE * period)
    return master, period, same
