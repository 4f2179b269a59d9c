"""Estimate the clock line of one device from its readings, detect outliers, and find the cause of jumps."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Literal

import numpy as np

from panoptic_ros.clocks.config import ClocksConfig
from panoptic_ros.clocks.estimate import ClockReading, estimate
from panoptic_ros.clocks.timeline import SECOND, MasterTimeline
from panoptic_ros.domain import ClockModel, FrameRate, Timecode, TimecodeReading
from panoptic_ros.params import named_numbers, of_name
from panoptic_ros.stage import Notice

LEAST_TOLERANCE = 2e-4  # s, minimum outlier tolerance
LARGEST_GROWTH = 0.25  # s, maximum growth of the tolerance after a gap; a timestamp years ahead is not a gap
NOISE_FACTOR = 8.0  # ratio of the outlier tolerance to the standard deviation of the readings
UNKNOWN_DRIFT = 3e-4  # drift assumed for a clock without measurements
FRAME_SHARE = 0.1  # frames, maximum distance of a jump from whole frames to be rounded to them
MORE_WORDS = 6  # words to wait if samples do not show the cause: another device may report a timecode jump
FEW_POINTS = 20  # minimum number of points to estimate the timestamp scatter
SURE_RATE = 4e-4  # drift below which the frame rate is certain; 29.97 and 30 differ by 1e-3, crystals by 1e-4
LARGEST_RATE = 0.01  # maximum drift of a generator that is set to another rate
LONG_NS = 3 * SECOND  # ns of readings before the drift distinguishes tapes from generators
# consecutive readings off the line without another line through them: the timestamps became noisier
NOISY_WORDS = 12
Cause = Literal["clock", "timecode"]


@dataclass
class Samples:
    """Sample count of the device, used as a second time axis."""

    last: float = -1.0  # sample index of the newest point
    period: float = 0.0  # s per sample; 0 = unknown


class DeviceClock:
    """Clock line of one device.

    Time is measured three times: by the label, the timestamp and the sample count. A reading off the line is
    an outlier and is kept separately. If several outliers agree, the measure that disagrees with the other
    two has jumped.

    Args:
        name: name of the device.
        config: parameters of the stage.
        timeline: master time line, shared with other devices.
        delayed: (name) entry of `delays_ms` that gives the delay; "" = `name`.
    """

    def __init__(self, name: str, config: ClocksConfig, timeline: MasterTimeline, delayed: str = ""):
        self._name = name
        self._config = config
        self._timeline = timeline
        delays = named_numbers("ClocksConfig.delays_ms", config.delays_ms)
        self._delay_ns = round(1e6 * of_name(delays, delayed or name))
        self._segment = -1
        self._model: ClockModel | None = None
        self._prior: ClockModel | None = None  # model of readings other than those of the line
        self._noise: float | None = None
        self._usual_noise = 0.0
        self._one_way = config.stamps == "one-way"
        self._rate: FrameRate | None = None
        self._start()

    def _start(self, points: list[ClockReading] | None = None) -> None:
        """Start a new line from the given points."""
        self._segment += 1
        self._points: deque[ClockReading] = deque(points or [])
        self._strays: list[ClockReading] = []
        self._samples = Samples()
        if self._points:
            self._follow_samples(self._points[0], self._points[-1])
        self.urgent = True  # the next model is due as soon as it exists
        self.given_ns: int | None = None

    @property
    def newest_ns(self) -> int | None:
        """Return the device time (ns) of the newest point on the line; None if there is none."""
        return self._points[-1].device_ns if self._points else None

    @property
    def settled(self) -> bool:
        """Return whether the newest reading is on the line."""
        return not self._strays

    @property
    def line(self) -> ClockModel | None:
        """Return the newest line; None while the frame rate of its labels is uncertain.

        29.97 and 30 words per second have the same labels, as have 23.976 and 24. A fluttering tape, or sound
        with a wrong sample rate, makes one look like the other. All times are then wrong by seconds.
        """
        model, rate = self._model, self._rate
        if model is None or rate is None or model.segment != self._segment:
            return None
        alone = rate.nominal == 25 or rate.drop_frame
        sure = abs(model.drift) < SURE_RATE or (self.drift is not None and abs(self.drift) < LARGEST_RATE)
        return model if alone or sure else None

    @property
    def drift(self) -> float | None:
        """Return the rate of the timecode minus 1; None before `LONG_NS` of readings."""
        model = self._model
        if model is None or model.segment != self._segment or model.until_ns - model.from_ns < LONG_NS:
            return None
        return model.drift

    def take(self, reading: TimecodeReading) -> tuple[Notice, ...]:
        """Add a reading; return notices on rate changes, jumps, noise and late readings."""
        notices = self._check_rate(reading.timecode)
        stamp = max(0, reading.stamp_ns - self._delay_ns)
        expected, tolerance = self._expect(stamp)
        onward = bool(self._points) and stamp > self._points[-1].device_ns  # only then is `expected` valid
        master = self._timeline.master_ns(self._name, reading.timecode, expected if onward else None)
        noise = reading.std_samples * self._samples.period
        point = ClockReading(stamp, master, reading.start_sample, noise)
        if expected is not None and abs(master - expected) > tolerance * SECOND:
            point = replace(point, master_ns=self._timeline.master_ns(self._name, reading.timecode))
            self._strays.append(point)
            return notices + self._judge_strays(tolerance)
        if self._points and stamp <= self._points[-1].device_ns:
            text = f"a timecode reading of {self._name} is not later than the previous one and is left out"
            return (*notices, Notice("clocks.stamp_back", "warning", text, {"device": self._name}))
        self._strays = []
        self._add(point)
        return notices

    def model(self) -> ClockModel | None:
        """Fit and return the current line; None if there are too few readings."""
        points = list(self._points)
        if len(points) < 3:
            return None
        known = self._model is not None
        if not known and points[-1].device_ns - points[0].device_ns < self._config.least_span_s * SECOND:
            return None
        if self._model is not None and self._model.until_ns < points[0].device_ns:
            self._prior = self._model
        few = self._usual_noise if len(points) < FEW_POINTS else 0.0
        found = estimate(self._name, points, self._config.stamps, self._one_way, self._prior, few)
        self._one_way = found.one_way
        if len(points) >= FEW_POINTS:
            self._noise = self._usual_noise = found.noise
        self._model = replace(found.model, wander=1e-6 * self._config.wander_ppm, segment=self._segment)
        self.urgent = False
        self.given_ns = points[-1].device_ns
        return self._model

    def _check_rate(self, label: Timecode) -> tuple[Notice, ...]:
        """Restart the line if the frame rate changes, because all labels then have another meaning."""
        before, self._rate = self._rate, label.rate
        if before is None or before == label.rate:
            return ()
        self._timeline.forget(self._name)
        self._model = self._prior = None
        self._start()
        text = (
            f"the timecode of {self._name} runs at {float(label.rate.exact):.5g} Hz, not at the rate "
            "assumed at first"
        )
        return (Notice("clocks.rate", "info", text, {"device": self._name}),)

    def _expect(self, stamp: int) -> tuple[int | None, float]:
        """Return the expected master time (ns) of a reading, None if unknown, and its tolerance (s)."""
        if not self._points:
            return None, 0.0
        last = self._points[-1]
        gap = abs(stamp - last.device_ns) / SECOND
        model = self._model
        if model is None or model.segment != self._segment:
            count = len(self._points)
            newest = [self._points[k] for k in range(max(0, count - FEW_POINTS), count)]
            aheads = [point.master_ns - point.device_ns for point in newest]
            ahead = sorted(aheads[-5:])[len(aheads[-5:]) // 2]
            drift = model.drift if model is not None else 0.0
            base = self._config.jump_s
            if len(aheads) >= 5:
                scatter = (max(aheads) - min(aheads)) / SECOND
                base = min(max(NOISE_FACTOR * scatter, LEAST_TOLERANCE), base)
            return stamp + ahead + round(drift * (stamp - last.device_ns)), (
                base + min(UNKNOWN_DRIFT * gap, LARGEST_GROWTH)
            )
        noise = self._config.jump_s if self._noise is None else NOISE_FACTOR * self._noise
        base = min(max(noise, LEAST_TOLERANCE), self._config.jump_s)
        drift_error = 3.0 * float(np.sqrt(model.covariance[1, 1])) + 4e-6 * self._config.wander_ppm
        growth = min(min(drift_error, UNKNOWN_DRIFT) * gap, LARGEST_GROWTH)
        return model.master_from_device(stamp)[0], base + growth

    def _add(self, point: ClockReading) -> None:
        self._follow_samples(self._points[0] if self._points else point, point)
        self._points.append(point)
        horizon = point.device_ns - round(self._config.window_s * SECOND)
        while self._points[0].device_ns < horizon:
            self._points.popleft()
        self._timeline.heard(self._name, point.master_ns)

    def _follow_samples(self, first: ClockReading, last: ClockReading) -> None:
        """Measure the duration of a sample by the timecode."""
        if last.sample > first.sample and last.sample > self._samples.last:
            self._samples.period = (last.master_ns - first.master_ns) / SECOND / (last.sample - first.sample)
        self._samples.last = last.sample

    # ------------------------------------------------------------------ outliers

    def _judge_strays(self, tolerance: float) -> tuple[Notice, ...]:
        self._strays = self._strays[-NOISY_WORDS:]
        agreeing = 1
        for before, after in zip(self._strays[-2::-1], self._strays[:0:-1]):
            change = (after.master_ns - after.device_ns) - (before.master_ns - before.device_ns)
            if abs(change) > tolerance * SECOND or after.device_ns <= before.device_ns:
                break
            agreeing += 1
        if agreeing >= self._config.jump_words:
            strays = self._strays[-agreeing:]
            misses = sorted(stray.master_ns - (self._expect(stray.device_ns)[0] or 0) for stray in strays)
            jump = self._whole_frames(misses[len(misses) // 2], tolerance)
            cause = self._cause(strays[0], jump, tolerance)
            if cause is not None or agreeing >= self._config.jump_words + MORE_WORDS:
                return self._jump(strays, jump, cause or "clock")
        if len(self._strays) == NOISY_WORDS and agreeing < self._config.jump_words:
            return self._noisier()
        return ()

    def _jump(self, strays: list[ClockReading], jump: int, cause: Cause) -> tuple[Notice, ...]:
        """Continue on the line of readings that agree, and return a notice on the cause of the jump."""
        values = {"device": self._name, "step_s": jump / SECOND, "cause": cause}
        if cause == "timecode":
            self._timeline.jumped(self._name, jump)
            self._strays = []
            for stray in strays:
                self._add(replace(stray, master_ns=stray.master_ns - jump))
            text = f"the timecode of {self._name} jumped by {jump / SECOND:+.4g} s; master time continues"
            return (Notice("clocks.timecode_jump", "info", text, values),)
        self._prior = self._model
        missed = self._timeline.rejoin(self._name, strays[-1].master_ns)
        strays = [replace(stray, master_ns=stray.master_ns + missed) for stray in strays]
        self._start(strays)
        self._timeline.heard(self._name, strays[-1].master_ns)
        self._noise = None
        text = f"timecode against the clock of {self._name} jumped by {jump / SECOND:+.4g} s"
        return (Notice("clocks.jump", "warning", text, values),)

    def _whole_frames(self, jump: int, tolerance: float) -> int:
        """Round a jump (ns) to whole frames if it is close to them.

        Generators are set by whole frames, so that the rounded jumps of several devices agree.
        """
        rate = self._rate.exact if self._rate is not None else Fraction(1)
        whole = round(round(Fraction(jump, SECOND) * rate) * SECOND / rate)
        near = min(tolerance, FRAME_SHARE / float(rate)) * SECOND
        return whole if abs(whole - jump) <= near else jump

    def _cause(self, stray: ClockReading, jump: int, tolerance: float) -> Cause | None:
        """Return the cause of a jump: the timecode or the clock; None if it is uncertain.

        The timecode has jumped if samples agree with timestamps. The clock has jumped if samples agree with
        labels.
        """
        if self._timeline.known_jump(self._name, jump):
            return "timecode"
        last, samples = self._points[-1], self._samples
        if samples.period == 0.0 or stray.sample <= last.sample:
            return None
        by_samples = (stray.sample - last.sample) * samples.period
        miss = (stray.master_ns - last.master_ns) / SECOND - by_samples
        allowed = max(min(tolerance, self._config.jump_s), 1e-3)
        allowed += min(UNKNOWN_DRIFT * by_samples, LARGEST_GROWTH)
        causes: dict[Cause, float] = {"timecode": abs(miss - jump / SECOND), "clock": abs(miss)}
        likely = min(causes, key=lambda cause: causes[cause])
        return likely if causes[likely] <= allowed else None

    def _noisier(self) -> tuple[Notice, ...]:
        """Accept the outliers, on the old line or on a new one, because timestamps scatter more than before.

        Returns: a notice on the larger scatter.
        """
        misses = sorted(s.master_ns - (self._expect(s.device_ns)[0] or 0) for s in self._strays)
        strays, middle = self._strays, misses[len(misses) // 2] / SECOND
        self._noise = None
        if abs(middle) <= self._config.jump_s and strays[0].device_ns > self._points[-1].device_ns:
            self._strays, self._prior = [], self._model
            self._points.clear()
            for stray in sorted(strays, key=lambda point: point.device_ns):
                self._add(stray)
        else:
            self._prior = self._model
            self._start(sorted(strays, key=lambda point: point.device_ns))
        text = f"stamps of {self._name} scatter more than before, about {middle:+.4g} s from its line"
        return (Notice("clocks.noisy", "warning", text, {"device": self._name}),)
