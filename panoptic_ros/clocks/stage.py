"""Clocks stage: convert the timecode readings of any number of devices to clock models.

Readings may name the clock behind the timecode, as a recorder can receive several timecodes. The timestamps
of a camera on such a clock equal its timecode: real time since the timecode's midnight. Two timecodes in one
recorder share the sample index as their axis. The line from one clock to the other therefore needs no
computer timestamps, and the recorder's own rate cancels (Joo et al. 2017, 3.3). If one recorder receives A
and B, and another B and C, their lines are chained.

A `ClockModel` is a line y = x + offset + drift (x - reference) between any two clocks. Offsets stay whole
nanoseconds, so that times since 1970 lose no precision.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction

import numpy as np

from panoptic_ros.clocks.config import ClocksConfig
from panoptic_ros.clocks.device import DeviceClock, Samples
from panoptic_ros.clocks.estimate import ClockReading
from panoptic_ros.clocks.exchanged import ExchangedChannels
from panoptic_ros.clocks.timeline import SECOND, SILENT_NS, MasterTimeline, TimelinePosition
from panoptic_ros.domain import ClockModel, FrameRate, TimecodeReading
from panoptic_ros.stage import Notice, StageContext, StepResult
from panoptic_ros.state import Fields, Stateful, StateLayout

STEP_NS = 1_000_000  # ns, difference of two lines of a clock that noise cannot cause
STEP_SIGMAS = 8.0  # limit as STEP_NS, in standard deviations; the larger of the two limits counts
AFTER_STEP_NS = 400_000_000  # ns between a jump and the first model of the new line
Models = list[ClockModel]
FOREVER = 2**63 - 1
RATE_OFF = 600e-6  # no crystal deviates by more; 29.97 and 30 fps differ by 1000 ppm
NO_CLOCK = 0.01  # drift above which timecode gives no clock


class NamedClocks:
    """Lines from named clocks, and from the clocks of the recorders that receive them, to a master clock.

    Args:
        config: parameters for the clocks of recorders.
        by_samples: parameters for times that are sample counts.
        master: name of the master clock.
        timeline: time line of the master clock.
    """

    def __init__(self, config: ClocksConfig, by_samples: ClocksConfig, master: str, timeline: MasterTimeline):
        self._config, self._by_samples = config, by_samples
        self._master = master
        self._timelines = {master: timeline}
        # by recorder and clock: line from sample time to the clock's time
        self._lines: dict[str, dict[str, DeviceClock]] = {}
        # a clock, and the line from timestamps to time of this clock; by recorder
        self._own: dict[str, tuple[str, DeviceClock]] = {}
        self._given: dict[str, ClockModel] = {}
        self._given_at: dict[str, int] = {}  # sample time of the last models, by recorder
        self._begun: dict[str, int] = {}  # by clock: start of its current segment
        self._rates: dict[str, int] = {}  # by recorder: nominal samples per second
        self._rate_off: set[str] = set()  # recorders whose wrong rate has been reported
        self._exchanged = ExchangedChannels()

    def take(self, reading: TimecodeReading) -> tuple[Models, tuple[Notice, ...]]:
        """Add a reading; return the models that are due, and notices."""
        recorder, clock = reading.device, reading.clock
        timeline = self._timelines.setdefault(clock, MasterTimeline())
        lines = self._lines.setdefault(recorder, {})
        if clock not in lines:
            lines[clock] = DeviceClock(f"{clock} in {recorder}", self._by_samples, timeline, clock)
        if recorder not in self._own:
            self._own[recorder] = clock, DeviceClock(recorder, self._config, timeline)
        sample_ns = _sample_ns(reading)
        owner = self._exchanged.owner(
            reading,
            sample_ns,
            {name: own.line for name, own in lines.items()},
            {name: self._timelines[name].shift_of(f"{name} in {recorder}") for name in lines},
        )
        if owner is not None:
            return [], self._exchanged.notices(reading, sample_ns, owner)
        notices = lines[clock].take(replace(reading, stamp_ns=sample_ns))
        self._rates[recorder] = reading.sample_rate
        held, own = self._own[recorder]
        if held == clock:
            told = {notice.code for notice in notices}
            notices += tuple(n for n in own.take(reading) if n.code not in told)
        if not self._is_due(recorder):
            return [], notices
        return self.due(recorder), notices + self._check_rate(recorder)

    def due(self, recorder: str) -> Models:
        """Return new models of the clocks that a recorder has received since its last models."""
        lines = self._lines[recorder]
        for line in lines.values():
            line.model()
        self._given_at[recorder] = self._time(recorder)
        to_master = self._to_master()
        found = [self._named(clock, to_master[clock]) for clock in lines if clock in to_master]
        held, own = self._own[recorder]
        stamps = own.model() if own.newest_ns != own.given_ns else None
        if stamps is not None and held in to_master:
            found.append(behind(stamps, to_master[held]))
        return [self._counted(model) for model in found if self._is_new(model)]

    def flush(self) -> Models:
        """Return the last models."""
        return [model for recorder in self._lines for model in self.due(recorder)]

    # ------------------------------------------------------------------ helpers

    def _time(self, recorder: str) -> int:
        """Return the newest time of a recorder by its sample count, ns."""
        return max((line.newest_ns or 0 for line in self._lines[recorder].values()), default=0)

    def _is_due(self, recorder: str) -> bool:
        lines = self._lines[recorder].values()
        if not all(line.settled for line in lines):
            return False
        since = self._time(recorder) - self._given_at.get(recorder, -SECOND)
        return not 0 <= since < self._config.period_s * SECOND or any(line.urgent for line in lines)

    def _to_master(self) -> dict[str, ClockModel]:
        """Return the lines to master time, for all clocks connected to the master clock."""
        heard = [
            (line.newest_ns, line.line)
            for lines in self._lines.values()
            for clock, line in lines.items()
            if clock == self._master
        ]
        spans = [inverse(line, self._master) for newest, line in heard if newest is not None and line]
        if not spans:
            return {}
        newest = max(span.until_ns for span in spans)
        found = {self._master: standing(self._master, min(span.from_ns for span in spans), newest)}
        while (more := dict(self._next_to(found))) and more.keys() - found.keys():
            found |= {clock: line for clock, line in more.items() if clock not in found}
        return found

    def _next_to(self, known: dict[str, ClockModel]) -> Iterator[tuple[str, ClockModel]]:
        """Yield the clocks that share a recorder with a connected clock, with their lines."""
        for lines in self._lines.values():
            sure = {clock: line.line for clock, line in lines.items() if line.line and line.settled}
            through = next((clock for clock in known if clock in sure), None)
            if through is None:
                continue
            from_samples = behind(sure[through], known[through])
            for clock, line in sure.items():
                if clock not in known:
                    yield clock, behind(inverse(line, clock), from_samples)

    def _named(self, clock: str, line: ClockModel) -> ClockModel:
        """Return the model of a clock that takes label times; labels may have jumped."""
        names = [(own[clock].newest_ns or 0, name) for name, own in self._lines.items() if clock in own]
        shift = self._timelines[clock].shift_of(f"{clock} in {max(names)[1]}")
        return by_labels(replace(line, device=clock), shift)

    def _is_new(self, model: ClockModel) -> bool:
        before = self._given.get(model.device)
        return before is None or model.until_ns != before.until_ns

    def _counted(self, model: ClockModel) -> ClockModel:
        """Return the model with its segment number; a stepped line begins a new segment."""
        before = self._given.get(model.device)
        segment = 0 if before is None else before.segment
        if before is not None and _stepped(before, model):
            segment += 1
            self._begun[model.device] = model.until_ns - AFTER_STEP_NS
        begun = min(self._begun.get(model.device, 0), model.until_ns)
        model = replace(model, segment=segment, from_ns=max(model.from_ns, begun))
        self._given[model.device] = model
        return model

    def _check_rate(self, recorder: str) -> tuple[Notice, ...]:
        """Report once if timecodes deviate from the sample rate by more than crystals do."""
        drifts = {clock: line.drift for clock, line in self._lines[recorder].items()}
        off = {clock: drift for clock, drift in drifts.items() if drift and abs(drift) > RATE_OFF}
        if not off or recorder in self._rate_off or None in drifts.values():
            return ()
        self._rate_off.add(recorder)
        clocks, drift, rate = ", ".join(sorted(off)), next(iter(off.values())), self._rates[recorder]
        text = f"the timecode of {clocks} runs {1e6 * drift:+.0f} ppm against the samples of {recorder}"
        if len(off) == len(drifts) and rate:
            text += f": its sound has about {rate / (1.0 + drift):.0f} Hz instead of the stated {rate} Hz"
            text += "; correct the rate, otherwise 29.97 and 30 frames per second cannot be distinguished"
        else:
            text += ": more than any crystal; set its generator to the rate of its labels (29.97 is not 30)"
        return (Notice("clocks.timecode_rate", "warning", text, {"device": recorder}),)


def _stepped(before: ClockModel, model: ClockModel) -> bool:
    """Return whether two lines of a clock differ by more than noise at the end of the second one."""
    at = model.until_ns
    (old, old_std), (new, std) = before.master_from_device(at), model.master_from_device(at)
    return abs(new - old) > max(STEP_NS, STEP_SIGMAS * (old_std + std))


def _sample_ns(reading: TimecodeReading) -> int:
    """Return the start of a word (ns) by the sample count, or its timestamp if the sample rate is unknown."""
    if not reading.sample_rate:
        return reading.stamp_ns
    return max(0, round(reading.start_sample * SECOND / reading.sample_rate))


def standing(clock: str, from_ns: int, until_ns: int) -> ClockModel:
    """Return the identity line of a clock, valid between two of its times."""
    return ClockModel(clock, until_ns, 0, 0.0, np.zeros((2, 2)), 0.0, from_ns, until_ns)


def inverse(line: ClockModel, clock: str) -> ClockModel:
    """Return the inverse line, from y to x.

    Args:
        clock: name of y.
    """
    slope = 1.0 + line.drift
    return ClockModel(
        clock,
        max(0, line.reference_ns + line.offset_ns),
        -line.offset_ns,
        -line.drift / slope,
        line.covariance,
        -line.residual_ns / slope,
        max(0, line.master_from_device(line.from_ns)[0]),
        max(0, line.master_from_device(line.until_ns)[0]),
        line.wander,
    )


def behind(first: ClockModel, second: ClockModel) -> ClockModel:
    """Return the line from x to z, composed of one from x to y and one from y to z.

    Their errors are assumed independent. The result is valid where both lines are.
    """
    at = first.reference_ns + first.offset_ns  # y at the reference, except for the residual
    since = at - second.reference_ns + first.residual_ns
    carry = np.array([[1.0, since * 1e-9], [0.0, 1.0]])
    seen = [
        stamp + at - first.reference_ns + round(first.drift * (stamp - first.reference_ns))
        for stamp in (first.from_ns, first.until_ns)
    ]
    return replace(
        first,
        offset_ns=first.offset_ns + second.offset_ns,
        residual_ns=first.residual_ns + second.residual_ns + second.drift * since,
        drift=(1.0 + first.drift) * (1.0 + second.drift) - 1.0,
        covariance=first.covariance + carry @ second.covariance @ carry.T,
        from_ns=first.from_ns + max(0, second.from_ns - seen[0]),
        until_ns=max(first.from_ns, first.until_ns - max(0, seen[1] - second.until_ns)),
        wander=first.wander + second.wander,
    )


def by_labels(line: ClockModel, shift_ns: int) -> ClockModel:
    """Convert a line from continuous timecode time to one from label time, which is smaller by the shift."""
    return replace(
        line,
        reference_ns=max(0, line.reference_ns - shift_ns),
        offset_ns=line.offset_ns + shift_ns,
        from_ns=max(0, line.from_ns - shift_ns),
        until_ns=max(0, line.until_ns - shift_ns),
    )


class ClocksStage(Stateful):
    """Stage that converts timecode readings to clock models, see the package docstring.

    Devices share the master time line and nothing else. Readings with the name of a clock go to
    `NamedClocks`. The master clock there has the same time line as the other devices.
    """

    LAYOUT = StateLayout(
        "clocks",
        ("_timeline", "_devices", "_silent", "_rate_off", "_named"),
        (
            ClockModel,
            FrameRate,
            ClockReading,
            TimelinePosition,
            Samples,
            Fields.named(Fraction, "_numerator _denominator", is_value=True),
            Fields.named(MasterTimeline, "_shifts _places"),
            Fields.named(
                DeviceClock,
                "_name _config _timeline _delay_ns _segment _model _prior _noise _usual_noise _one_way _rate "
                "_points _strays _samples urgent given_ns",
            ),
            Fields.named(
                NamedClocks,
                "_config _by_samples _master _timelines _lines _own _given _given_at _begun _rates _rate_off "
                "_exchanged",
            ),
            Fields.named(ExchangedChannels, "_counts _on_line _off_since _told"),
        ),
        shared=("_config", "_by_samples"),
        same={"configuration": "_config"},
    )

    def __init__(self, config: ClocksConfig, context: StageContext | None = None):
        self._config = config
        self._by_samples = replace(config, stamps="symmetric")
        self.reset()

    def reset(self) -> None:
        """Drop the state of all devices."""
        self._timeline = MasterTimeline()
        self._devices: dict[str, DeviceClock] = {}
        self._silent: set[str] = set()
        self._rate_off: set[str] = set()
        self._named: NamedClocks | None = None

    def step(self, item: TimecodeReading) -> StepResult[ClockModel]:
        """Add a reading; return its device's model every `period_s`, and immediately after a jump."""
        if item.reverse:
            text = f"the timecode of {item.device} runs backwards and is not a clock"
            return StepResult((), (Notice("clocks.reverse", "warning", text, {"device": item.device}),))
        if item.clock:
            return self._step_named(item)
        device = self._devices.get(item.device)
        if device is None:
            device = self._devices[item.device] = DeviceClock(item.device, self._config, self._timeline)
        notices = device.take(item) + self._listen()
        newest, given = device.newest_ns, device.given_ns
        if newest is None:
            return StepResult((), notices)
        due = given is None or newest - given >= self._config.period_s * SECOND
        model = device.model() if (due or device.urgent) and newest != given else None
        if model is None:
            return StepResult((), notices)
        notices += self._check_rate(model)
        if not _usable(model):
            self._timeline.forget(model.device)  # such a device must not change the time of others
            return StepResult((), notices)
        return StepResult((model,), notices)

    def _step_named(self, item: TimecodeReading) -> StepResult[ClockModel]:
        """Add a reading of a named clock; return the models of all clocks that its recorder receives."""
        if self._named is None:
            master = self._config.master_clock or item.clock
            self._named = NamedClocks(self._config, self._by_samples, master, self._timeline)
        models, notices = self._named.take(item)
        return StepResult(tuple(model for model in models if _usable(model)), notices)

    def flush(self) -> StepResult[ClockModel]:
        """Return the last model of every device with readings newer than its last model."""
        models = [device.model() for device in self._devices.values() if device.newest_ns != device.given_ns]
        known = [model for model in models if model is not None]
        notices = tuple(notice for model in known for notice in self._check_rate(model))
        known += self._named.flush() if self._named is not None else []
        self.reset()
        return StepResult(tuple(model for model in known if _usable(model)), notices)

    def _check_rate(self, model: ClockModel) -> tuple[Notice, ...]:
        """Report once that the timecode of a device runs at a rate other than its nominal one."""
        if _surely(model) <= RATE_OFF or model.device in self._rate_off:
            return ()
        self._rate_off.add(model.device)
        unused = "" if _usable(model) else "; its clock is not used"
        text = (
            f"the timecode at {model.device} runs {1e6 * model.drift:+.0f} ppm against its clock: "
            "more than any crystal; set generator and recorder to the same rate (29.97 is not 30), and check "
            f"pull-up and pull-down{unused}"
        )
        return (Notice("clocks.timecode_rate", "warning", text, {"device": model.device}),)

    def _listen(self) -> tuple[Notice, ...]:
        """Report once that a device no longer receives timecode while others do."""
        silent = set(self._timeline.silent())
        fresh = sorted(silent - self._silent)
        self._silent = silent
        return tuple(
            Notice(
                "clocks.silent",
                "warning",
                f"no timecode from {name} for {SILENT_NS // SECOND} s; its clock is held over",
                {"device": name},
            )
            for name in fresh
        )


def _surely(model: ClockModel) -> float:
    """Return the lower bound of the absolute drift (3 standard deviations)."""
    return abs(model.drift) - 3.0 * float(np.sqrt(model.covariance[1, 1]))


def _usable(model: ClockModel) -> bool:
    return _surely(model) <= NO_CLOCK
