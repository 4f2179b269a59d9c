"""The clocks stage: timecode readings of any number of devices to clock models."""
from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from panoptic_ros.clocks.config import ClocksConfig
from panoptic_ros.clocks.line import fit_line
from panoptic_ros.domain import ClockModel, DeviceNs, Timecode, TimecodeReading
from panoptic_ros.errors import DataError
from panoptic_ros.stage import Notice, StageContext, StepResult

SECOND = 1_000_000_000


@dataclass(frozen=True, slots=True)
class _Point:
    """A reading as a pair of times: device and master, ns, with the standard deviation, s."""

    device_ns: int
    master_ns: int
    noise_s: float


@dataclass
class _Device:
    """The readings of one device since its last jump."""

    points: deque[_Point] = field(default_factory=deque)
    strays: list[_Point] = field(default_factory=list)  # consecutive readings off the line
    last: TimecodeReading | None = None
    model: ClockModel | None = None
    given_ns: int | None = None  # device time of the last model that was handed out


class ClocksStage:
    """See the package. Devices do not influence each other."""

    def __init__(self, config: ClocksConfig, context: StageContext | None = None):
        self._config = config
        self.reset()

    def reset(self) -> None:
        """Forget all devices."""
        self._devices: dict[str, _Device] = {}

    def step(self, item: TimecodeReading) -> StepResult[ClockModel]:
        """Take a reading; gives the device's model every `period_s`.

        Raises:
            DataError: if its numbers are not finite.
        """
        if not (np.isfinite(item.start_sample) and item.std_samples >= 0.0 and item.stamp_ns >= 0):
            raise DataError(f"a timecode reading of {item.device} at {item.timecode} is not finite")
        if item.reverse:
            text = f"the timecode of {item.device} runs backwards and is no clock"
            return StepResult((), (Notice("clocks.reverse", "warning", text, {"device": item.device}),))
        device = self._devices.setdefault(item.device, _Device())
        if device.last is not None and item.stamp_ns <= device.last.stamp_ns:
            text = f"a timecode reading of {item.device} is not later than the one before; left out"
            return StepResult((), (Notice("clocks.stamp_back", "warning", text, {"device": item.device}),))
        notices = self._take(device, item)
        due = device.given_ns is None or item.stamp_ns - device.given_ns >= self._config.period_s * SECOND
        if not due or not self._ready(device):
            return StepResult((), notices)
        device.model = _model(item.device, device.points)
        device.given_ns = item.stamp_ns
        return StepResult((device.model,), notices)

    def flush(self) -> StepResult[ClockModel]:
        """The last model of every device that has readings newer than its last one."""
        models = []
        for name, device in self._devices.items():
            newest = device.points[-1].device_ns if device.points else None
            if newest is not None and newest != device.given_ns and self._ready(device):
                models.append(_model(name, device.points))
        self.reset()
        return StepResult(tuple(models))

    def _take(self, device: _Device, item: TimecodeReading) -> tuple[Notice, ...]:
        """Add a reading to the line, or to those that are off it."""
        point = _point(item, device)
        device.last = item
        if self._near(point, device.points):
            device.strays = []
            device.points.append(point)
            horizon = point.device_ns - round(self._config.window_s * SECOND)
            while device.points[0].device_ns < horizon:
                device.points.popleft()
            return ()
        if not self._near(point, device.strays):
            device.strays = []
        device.strays.append(point)
        if len(device.strays) < self._config.jump_words:
            return ()
        step = (point.master_ns - point.device_ns) - _line_difference(device.points, point.device_ns)
        device.points, device.strays = deque(device.strays), []
        device.model = device.given_ns = None
        text = f"timecode against the clock of {item.device} jumped by {step / SECOND:+.4g} s"
        return (Notice("clocks.jump", "warning", text, {"device": item.device, "step_s": step / SECOND}),)

    def _near(self, point: _Point, points: deque[_Point] | list[_Point]) -> bool:
        """Whether a point lies near the line of others, or there are none."""
        if not points:
            return True
        miss = point.master_ns - point.device_ns - _line_difference(points, point.device_ns)
        since = (point.device_ns - points[-1].device_ns) / SECOND
        return abs(miss) / SECOND <= self._config.jump_s * max(1.0, since)

    def _ready(self, device: _Device) -> bool:
        points = device.points
        span = (points[-1].device_ns - points[0].device_ns) / SECOND if points else 0.0
        return len(points) >= 3 and span >= self._config.least_span_s


def _line_difference(points: deque[_Point] | list[_Point], device_ns: int) -> int:
    """Master minus device time that a point at `device_ns` should have: that of the last points."""
    recent = [points[i] for i in range(max(0, len(points) - 5), len(points))]
    middle = sorted(point.master_ns - point.device_ns for point in recent)[len(recent) // 2]
    first = points[0]
    span = recent[-1].device_ns - first.device_ns
    if span < SECOND:
        return middle
    change = (middle - (first.master_ns - first.device_ns)) / span  # drift so far
    return middle + round(change * (device_ns - recent[-1].device_ns))


def _point(item: TimecodeReading, device: _Device) -> _Point:
    """The reading as two times; master time counts on over midnight."""
    master = _day_ns(item.timecode)
    noise = 0.0
    if device.last is not None:
        samples = item.start_sample - device.last.start_sample
        if samples > 0.0:
            noise = item.std_samples * (item.stamp_ns - device.last.stamp_ns) / samples / SECOND
    if device.points:
        day = _day_length_ns(item.timecode)
        expected = item.stamp_ns + _line_difference(device.points, item.stamp_ns)
        master += day * round((expected - master) / day)
    return _Point(item.stamp_ns, master, noise)


def _day_ns(timecode: Timecode) -> int:
    """Real time since the timecode's midnight."""
    rate = timecode.rate.exact
    return timecode.frame_count * SECOND * rate.denominator // rate.numerator


def _day_length_ns(timecode: Timecode) -> int:
    rate = timecode.rate
    frames = 24 * 107_892 if rate.drop_frame else 24 * 3600 * rate.nominal
    return frames * SECOND * rate.exact.denominator // rate.exact.numerator


def _model(device: str, points: deque[_Point]) -> ClockModel:
    """The line through the window's points, stated about their middle."""
    reference = points[len(points) // 2]
    base = reference.master_ns - reference.device_ns
    x = np.array([(point.device_ns - reference.device_ns) / SECOND for point in points])
    y = np.array([(point.master_ns - point.device_ns - base) / SECOND for point in points])
    line = fit_line(x, y, np.array([point.noise_s for point in points]))
    return ClockModel(
        device, DeviceNs(reference.device_ns), base, line.slope, line.covariance, SECOND * line.offset,
        points[0].device_ns, points[-1].device_ns,
    )  # fmt: skip
