"""The timecode stage: audio blocks of any number of devices to readings."""
from __future__ import annotations

from panoptic_ros.domain import AudioBlock, TimecodeReading
from panoptic_ros.stage import Notice, StageContext, StepResult
from panoptic_ros.state import Stateful
from panoptic_ros.timecode.config import TimecodeConfig
from panoptic_ros.timecode.decoder import LtcDecoder
from panoptic_ros.timecode.follow.breaks import Heard, find_break
from panoptic_ros.timecode.follow.reading import Word
from panoptic_ros.timecode.kernels import compile_kernels
from panoptic_ros.timecode.remembered import LAYOUT, Device

STAMPS_SECONDS = 3.0  # of block stamps are kept: more than a word waits to be reported


class TimecodeStage(Stateful):
    """See the package. A gap or another sample rate starts a device anew; nothing of before is remembered.

    The constructor compiles the kernels, or takes them from numba's cache.
    """

    LAYOUT = LAYOUT

    def __init__(self, config: TimecodeConfig, context: StageContext | None = None):
        self._config = config
        self._devices: dict[str, Device] = {}
        compile_kernels()

    def step(self, item: AudioBlock) -> StepResult[TimecodeReading]:
        """Readings that the block completes."""
        readings: list[TimecodeReading] = []
        notices: list[Notice] = []
        device = self._devices.get(item.device)
        if device is not None and (
            item.first_sample != device.next_sample or item.sample_rate != device.sample_rate
        ):
            readings += self._read(device, device.decoder.finish())
            notices.append(_gap(device, item))
            device = None
        if device is None:
            device = self._devices[item.device] = self._start(item)
        device.stamps.append((item.first_sample, item.stamp_ns))
        device.next_sample = item.first_sample + len(item.samples)
        horizon = device.next_sample - int(STAMPS_SECONDS * device.sample_rate)
        while len(device.stamps) > 1 and device.stamps[1][0] <= horizon:
            device.stamps.popleft()
        words = device.decoder.push(item.samples)
        notices += _breaks(device, words)
        readings += self._read(device, words)
        return StepResult(tuple(readings), tuple(notices))

    def flush(self) -> StepResult[TimecodeReading]:
        """Words that end with the stream."""
        devices = self._devices.values()
        readings = [r for device in devices for r in self._read(device, device.decoder.finish())]
        self.reset()
        return StepResult(tuple(readings))

    def reset(self) -> None:
        """Forget all devices."""
        self._devices = {}

    def _start(self, block: AudioBlock) -> Device:
        decoder = LtcDecoder(self._config, block.sample_rate)
        return Device(block.device, block.sample_rate, block.first_sample, decoder)

    def _read(self, device: Device, words: list[Word]) -> list[TimecodeReading]:
        return [
            TimecodeReading(
                device=device.name,
                stamp_ns=_stamp(device, device.first_sample + word.start),
                timecode=word.timecode,
                start_sample=device.first_sample + word.start,
                std_samples=word.std,
                reverse=word.reverse,
                user_bits=word.user_bits,
            )
            for word in words
        ]


def _breaks(device: Device, words: list[Word]) -> list[Notice]:
    """Notices where labels or samples do not continue those of the last word."""
    notices: list[Notice] = []
    for word in words:
        heard = Heard(word, _stamp(device, device.first_sample + word.start))
        found = find_break(device.name, device.sample_rate, device.last, heard) if device.last else ()
        if found is not None:
            notices += found
            device.last = heard
    return notices


def _stamp(device: Device, sample: float) -> int:
    """The instant of a fractional sample on the device's clock, from the block that holds it."""
    first, stamp = next((block for block in reversed(device.stamps) if block[0] <= sample), device.stamps[0])
    return max(0, stamp + round((sample - first) / device.sample_rate * 1e9))


def _gap(device: Device, block: AudioBlock) -> Notice:
    if block.sample_rate != device.sample_rate:
        text = f"audio of {device.name} changed from {device.sample_rate} to {block.sample_rate} Hz"
    else:
        lost = block.first_sample - device.next_sample
        what = f"lost {lost} samples" if lost > 0 else f"went back by {-lost} samples"
        text = f"audio of {device.name} {what} before sample {block.first_sample}"
    return Notice("timecode.gap", "warning", text, {"device": device.name})
