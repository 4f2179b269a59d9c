"""The timecode stage: audio blocks of any number of devices to readings."""
from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

from panoptic_ros.domain import AudioBlock, TimecodeReading
from panoptic_ros.stage import Notice, StageContext, StepResult
from panoptic_ros.timecode.config import TimecodeConfig
from panoptic_ros.timecode.continuity import Continuity
from panoptic_ros.timecode.decoder import LtcDecoder, Word

STAMPS_SECONDS = 3.0  # of block stamps that are kept: longer than a word waits to be reported


@dataclass
class _Device:
    """One uninterrupted stream of a device."""

    name: str
    sample_rate: int
    first_sample: int
    decoder: LtcDecoder
    continuity: Continuity
    stamps: deque[tuple[int, int]] = field(default_factory=deque)  # first sample and stamp of blocks
    next_sample: int = 0


class TimecodeStage:
    """See the package. Gaps and other sample rates start a device anew; nothing else is remembered."""

    def __init__(self, config: TimecodeConfig, context: StageContext | None = None):
        self._config = config
        self._devices: dict[str, _Device] = {}

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
        jumps = device.continuity.jumps
        readings += self._read(device, device.decoder.push(item.samples))
        if device.continuity.jumps > jumps:
            text = f"the timecode of {device.name} jumped to {readings[-1].timecode}"
            notices.append(Notice("timecode.jump", "warning", text, {"device": device.name}))
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

    def _start(self, block: AudioBlock) -> _Device:
        decoder = LtcDecoder(self._config, block.sample_rate)
        continuity = Continuity(self._config.agreeing_words, block.sample_rate)
        return _Device(block.device, block.sample_rate, block.first_sample, decoder, continuity)

    def _read(self, device: _Device, words: list[Word]) -> list[TimecodeReading]:
        believed = [pair for word in words for pair in device.continuity.push(word)]
        return [
            TimecodeReading(
                device=device.name,
                stamp_ns=_stamp(device, device.first_sample + word.start),
                timecode=timecode,
                start_sample=device.first_sample + word.start,
                std_samples=word.std,
                reverse=word.reverse,
                user_bits=word.label.user_bits if word.label else 0,
            )
            for word, timecode in believed
        ]


def _stamp(device: _Device, sample: float) -> int:
    """The instant of a fractional sample on the device's clock, from the block that holds it."""
    first, stamp = device.stamps[0]
    for block_first, block_stamp in device.stamps:
        if block_first <= sample:
            first, stamp = block_first, block_stamp
    return max(0, stamp + round((sample - first) / device.sample_rate * 1e9))


def _gap(device: _Device, block: AudioBlock) -> Notice:
    if block.sample_rate != device.sample_rate:
        text = f"audio of {device.name} changed from {device.sample_rate} to {block.sample_rate} Hz"
    else:
        lost = block.first_sample - device.next_sample
        what = f"lost {lost} samples" if lost > 0 else f"went back by {-lost} samples"
        text = f"audio of {device.name} {what} before sample {block.first_sample}"
    return Notice("timecode.gap", "warning", text, {"device": device.name})
