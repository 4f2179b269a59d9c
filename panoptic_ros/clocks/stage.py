"""The clocks stage: timecode readings of any number of devices to clock models."""
from __future__ import annotations

import numpy as np

from panoptic_ros.clocks.config import ClocksConfig
from panoptic_ros.clocks.device import DeviceClock
from panoptic_ros.clocks.timeline import SECOND, SILENT_NS, Timeline
from panoptic_ros.domain import ClockModel, TimecodeReading
from panoptic_ros.errors import DataError
from panoptic_ros.stage import Notice, StageContext, StepResult


class ClocksStage:
    """See the package. Devices share the master time line and nothing else."""

    def __init__(self, config: ClocksConfig, context: StageContext | None = None):
        self._config = config
        self.reset()

    def reset(self) -> None:
        """Forget all devices."""
        self._timeline = Timeline()
        self._devices: dict[str, DeviceClock] = {}
        self._silent: set[str] = set()

    def step(self, item: TimecodeReading) -> StepResult[ClockModel]:
        """Take a reading; gives the device's model every `period_s`, and at once after a jump.

        Raises:
            DataError: if its numbers are not finite.
        """
        if not (np.isfinite(item.start_sample) and item.std_samples >= 0.0 and item.stamp_ns >= 0):
            raise DataError(f"a timecode reading of {item.device} at {item.timecode} is not finite")
        if item.reverse:
            text = f"the timecode of {item.device} runs backwards and is no clock"
            return StepResult((), (Notice("clocks.reverse", "warning", text, {"device": item.device}),))
        device = self._devices.get(item.device)
        if device is None:
            device = self._devices[item.device] = DeviceClock(item.device, self._config, self._timeline)
        notices = device.take(item) + self._listen()
        newest, given = device.newest_ns, device.given_ns
        if newest is None:
            return StepResult((), notices)
        due = given is None or newest - given >= self._config.period_s * SECOND
        model = device.model() if (due or device.urgent) and newest != given else None
        return StepResult((model,) if model is not None else (), notices)

    def flush(self) -> StepResult[ClockModel]:
        """The last model of every device that has readings newer than its last one."""
        models = [
            device.model() for device in self._devices.values() if device.newest_ns != device.given_ns
        ]
        self.reset()
        return StepResult(tuple(model for model in models if model is not None))

    def _listen(self) -> tuple[Notice, ...]:
        """Tell once of a device that has fallen silent while others are heard."""
        silent = set(self._timeline.silent())
        fresh = sorted(silent - self._silent)
        self._silent = silent
        return tuple(
            Notice(
                "clocks.silent", "warning",
                f"no timecode from {name} for {SILENT_NS // SECOND} s; its clock is held over",
                {"device": name},
            )
            for name in fresh
        )  # fmt: skip
