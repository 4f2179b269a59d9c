"""The clocks stage: timecode readings of any number of devices to clock models."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np

from panoptic_ros.clocks.config import ClocksConfig
from panoptic_ros.clocks.device import DeviceClock, Samples
from panoptic_ros.clocks.estimate import Point
from panoptic_ros.clocks.exchanged import ExchangedChannels
from panoptic_ros.clocks.named import NamedClocks
from panoptic_ros.clocks.timeline import SECOND, SILENT_NS, Place, Timeline
from panoptic_ros.domain import ClockModel, FrameRate, TimecodeReading
from panoptic_ros.stage import Notice, StageContext, StepResult
from panoptic_ros.state import Fields, Stateful, StateLayout

RATE_OFF = 600e-6  # no crystal errs by more; 29.97 and 30 fps differ by 1000 ppm
NO_CLOCK = 0.01  # timecode so far off its rate is no clock


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
