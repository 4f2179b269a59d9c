"""The clocks stage: timecode readings of any number of devices to clock models.

Clocks that are known by their timecode: several of them in the sound of one recorder.

A camera that is stamped by such a clock says what its timecode says: real time since its midnight. What the
recorder hears of two timecodes has one axis, its samples. So the line from one clock to the other needs no
stamp of any computer, and the recorder's own rate cancels (Joo et al. 2017, 3.3). Where one recorder hears A
and B, and another B and C, the lines follow each other.

A `ClockModel` is a line y = x + offset + drift (x - reference), whatever its two clocks are. Offsets stay
whole nanoseconds, so that times since 1970 lose nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction

import numpy as np

from panoptic_ros.clocks.config import ClocksConfig
from panoptic_ros.clocks.device import DeviceClock, Samples
from panoptic_ros.clocks.estimate import Point
from panoptic_ros.clocks.exchanged import ExchangedChannels
from panoptic_ros.clocks.timeline import SECOND, SILENT_NS, Place, Timeline
from panoptic_ros.domain import ClockModel, FrameRate, TimecodeReading
from panoptic_ros.stage import Notice, StageContext, StepResult
from panoptic_ros.state import Fields, Stateful, StateLayout

STEP_NS = 1_000_000  # between two lines of a clock, that is no noise
STEP_SIGMAS = 8.0
AFTER_STEP_NS = 400_000_000  # a line is there so long after the words that made it
Models = list[ClockModel]
FOREVER = 2**63 - 1
RATE_OFF = 600e-6  # no crystal errs by more; 29.97 and 30 fps differ by 1000 ppm
NO_CLOCK = 0.01  # timecode so far off its rate is no clock


class NamedClocks:
    """Lines from named clocks, and from the clocks of the recorders that hear them, to a master clock.

    Args:
        config: of the clocks of recorders. by_samples: the same for times that are counts of samples.
        master: name of a clock.
        timeline: its time.
    """

    def __init__(self, config: ClocksConfig, by_samples: ClocksConfig, master: str, timeline: Timeline):
        self._config, self._by_samples = config, by_samples
        self._master = master
        self._timelines = {master: timeline}
        self._lines: dict[str, dict[str, DeviceClock]] = {}  # recorder, clock: samples to the clock's time
        self._own: dict[str, tuple[str, DeviceClock]] = {}  # recorder: a clock, stamps to its time
        self._given: dict[str, ClockModel] = {}
        self._given_at: dict[str, int] = {}  # recorder: its time then
        self._begun: dict[str, int] = {}  # clock: where its segment began
        self._rates: dict[str, int] = {}  # recorder: samples per second, as it says
        self._rate_off: set[str] = set()  # recorders of which that was told
        self._exchanged = ExchangedChannels()

    def take(self, reading: TimecodeReading) -> tuple[Models, tuple[Notice, ...]]:
        """Take a reading; the models that are due."""
        recorder, clock = reading.device, reading.clock
        timeline = self._timelines.setdefault(clock, Timeline())
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
        """Models by all lines, of the clocks that a recorder has heard since the last ones."""
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
        """The last models."""
        return [model for recorder in self._lines for model in self.due(recorder)]

    # ------------------------------------------------------------------ helpers

    def _time(self, recorder: str) -> int:
        """The newest time of a recorder, by its samples."""
        return max((line.newest_ns or 0 for line in self._lines[recorder].values()), default=0)

    def _is_due(self, recorder: str) -> bool:
        lines = self._lines[recorder].values()
        if not all(line.settled for line in lines):
            return False
        since = self._time(recorder) - self._given_at.get(recorder, -SECOND)
        return not 0 <= since < self._config.period_s * SECOND or any(line.urgent for line in lines)

    def _to_master(self) -> dict[str, ClockModel]:
        """Lines from the times of clocks to that of the master, of all that are connected to it."""
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
        """Clocks that a recorder hears beside one that is known."""
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
        """The model of a clock: from what its timecode says, which may have jumped."""
        names = [(own[clock].newest_ns or 0, name) for name, own in self._lines.items() if clock in own]
        shift = self._timelines[clock].shift_of(f"{clock} in {max(names)[1]}")
        return by_labels(replace(line, device=clock), shift)

    def _is_new(self, model: ClockModel) -> bool:
        before = self._given.get(model.device)
        return before is None or model.until_ns != before.until_ns

    def _counted(self, model: ClockModel) -> ClockModel:
        """The model with its segment: a new one where it is not the line of before."""
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
        """Tell once that timecodes run at another rate than the samples, by more than crystals do."""
        drifts = {clock: line.drift for clock, line in self._lines[recorder].items()}
        off = {clock: drift for clock, drift in drifts.items() if drift and abs(drift) > RATE_OFF}
        if not off or recorder in self._rate_off or None in drifts.values():
            return ()
        self._rate_off.add(recorder)
        clocks, drift, rate = ", ".join(sorted(off)), next(iter(off.values())), self._rates[recorder]
        text = f"the timecode of {clocks} runs {1e6 * drift:+.0f} ppm against the samples of {recorder}"
        if len(off) == len(drifts) and rate:
            text += f": its sound is not of {rate} Hz, as it says, but of about {rate / (1.0 + drift):.0f} Hz"
            text += "; mend it, as 29.97 and 30 frames per second look alike then"
        else:
            text += ": more than any crystal; set its generator to the rate that it says (29.97 is not 30)"
        return (Notice("clocks.timecode_rate", "warning", text, {"device": recorder}),)


def _stepped(before: ClockModel, model: ClockModel) -> bool:
    """Whether two lines of a clock differ by more than noise where the second was observed last."""
    at = model.until_ns
    (old, old_std), (new, std) = before.master_from_device(at), model.master_from_device(at)
    return abs(new - old) > max(STEP_NS, STEP_SIGMAS * (old_std + std))


def _sample_ns(reading: TimecodeReading) -> int:
    """When a word began, by the count of samples; by its stamp where nobody says how many make a second."""
    if not reading.sample_rate:
        return reading.stamp_ns
    return max(0, round(reading.start_sample * SECOND / reading.sample_rate))


def standing(clock: str, from_ns: int, until_ns: int) -> ClockModel:
    """The line from a clock to itself, observed between two of its times."""
    return ClockModel(clock, until_ns, 0, 0.0, np.zeros((2, 2)), 0.0, from_ns, until_ns)


def inverse(line: ClockModel, clock: str) -> ClockModel:
    """The line from y to x.

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
    """The line from x to z, of one from x to y and one from y to z.

    Their errors are taken as independent. It is observed where both are.
    """
    at = first.reference_ns + first.offset_ns  # y of the reference, but for the residual
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
    """A line from times of a timecode that run on, as one from its labels: times less the shift."""
    return replace(
        line,
        reference_ns=max(0, line.reference_ns - shift_ns),
        offset_ns=line.offset_ns + shift_ns,
        from_ns=max(0, line.from_ns - shift_ns),
        until_ns=max(0, line.until_ns - shift_ns),
    )


class ClocksStage(Stateful):
    """See the package. Devices share the master time line and nothing else.

    Readings that name the clock behind the timecode are for `NamedClocks`; the master among these has the
    time line of the others.
    """

    LAYOUT = StateLayout(
        "clocks",
        ("_timeline", "_devices", "_silent", "_rate_off", "_named"),
        (
            ClockModel,
            FrameRate,
            Point,
            Place,
            Samples,
            Fields.named(Fraction, "_numerator _denominator", is_value=True),
            Fields.named(Timeline, "_shifts _places"),
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
        """Forget all devices."""
        self._timeline = Timeline()
        self._devices: dict[str, DeviceClock] = {}
        self._silent: set[str] = set()
        self._rate_off: set[str] = set()
        self._named: NamedClocks | None = None

    def step(self, item: TimecodeReading) -> StepResult[ClockModel]:
        """Take a reading; return the model of its device every `period_s`, and at once after a jump."""
        if item.reverse:
            text = f"the timecode of {item.device} runs backwards and is no clock"
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
            self._timeline.forget(model.device)  # it must not change the time of others
            return StepResult((), notices)
        return StepResult((model,), notices)

    def _step_named(self, item: TimecodeReading) -> StepResult[ClockModel]:
        """Take a reading of a named clock; return models of all clocks that its recorder hears."""
        if self._named is None:
            master = self._config.master_clock or item.clock
            self._named = NamedClocks(self._config, self._by_samples, master, self._timeline)
        models, notices = self._named.take(item)
        return StepResult(tuple(model for model in models if _usable(model)), notices)

    def flush(self) -> StepResult[ClockModel]:
        """The last model of every device that has readings newer than its last one."""
        models = [device.model() for device in self._devices.values() if device.newest_ns != device.given_ns]
        known = [model for model in models if model is not None]
        notices = tuple(notice for model in known for notice in self._check_rate(model))
        known += self._named.flush() if self._named is not None else []
        self.reset()
        return StepResult(tuple(model for model in known if _usable(model)), notices)

    def _check_rate(self, model: ClockModel) -> tuple[Notice, ...]:
        """Report once that the timecode of a device runs at another rate than it says."""
        if _surely(model) <= RATE_OFF or model.device in self._rate_off:
            return ()
        self._rate_off.add(model.device)
        unused = "" if _usable(model) else "; its clock is not used"
        text = (
            f"the timecode that {model.device} hears runs {1e6 * model.drift:+.0f} ppm against its clock: "
            "more than any crystal; set generator and recorder to the same rate (29.97 is not 30), and check "
            f"pull-up and pull-down{unused}"
        )
        return (Notice("clocks.timecode_rate", "warning", text, {"device": model.device}),)

    def _listen(self) -> tuple[Notice, ...]:
        """Report once that a device has fallen silent while others are heard."""
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
    """How large the drift is at least."""
    return abs(model.drift) - 3.0 * float(np.sqrt(model.covariance[1, 1]))


def _usable(model: ClockModel) -> bool:
    return _surely(model) <= NO_CLOCK
