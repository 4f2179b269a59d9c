"""The timecode stage: audio blocks of any number of devices to readings."""

from __future__ import annotations

import numpy as np

from panoptic_ros.domain import AudioBlock, TimecodeReading
from panoptic_ros.errors import DataError
from panoptic_ros.params import named_words
from panoptic_ros.stage import Notice, StageContext, StepResult
from panoptic_ros.state import Stateful
from panoptic_ros.timecode.config import TimecodeConfig
from panoptic_ros.timecode.decoder import LtcDecoder
from panoptic_ros.timecode.follow.breaks import Heard, find_break, is_one_timecode
from panoptic_ros.timecode.follow.reading import Word
from panoptic_ros.timecode.kernels import compile_kernels
from panoptic_ros.timecode.remembered import LAYOUT, Channel, Device

STAMPS_SECONDS = 3.0  # of block stamps are kept: more than a word waits to be reported


class TimecodeStage(Stateful):
    """See the package. A gap or another sample rate starts a device anew; nothing of before is remembered.

    Every channel that carries the timecode of a named clock has a decoder, or every channel if none is named.
    Then the first that is understood is the timecode that the device's own clock is held against.

    The constructor compiles the kernels, or takes them from numba's cache.
    """

    LAYOUT = LAYOUT

    def __init__(self, config: TimecodeConfig, context: StageContext | None = None):
        self._config = config
        self._named = {
            device: tuple(name.strip() for name in names.split(","))
            for device, names in named_words("TimecodeConfig.channels", config.channels).items()
        }
        self._devices: dict[str, Device] = {}
        compile_kernels()

    def step(self, item: AudioBlock) -> StepResult[TimecodeReading]:
        """Readings that the block completes.

        Raises:
            DataError: if it has other channels than the parameter names.
        """
        readings: list[TimecodeReading] = []
        notices: list[Notice] = []
        clocks = self._clocks(item)
        device = self._devices.get(item.device)
        if device is not None and not _continues(device, item, clocks):
            readings += self._finish(device)
            notices.append(_gap(device, item))
            device = None
        if device is None:
            device = self._devices[item.device] = self._start(item, clocks)
        device.stamps.append((item.first_sample, item.stamp_ns))
        device.next_sample = item.first_sample + len(item.samples)
        horizon = device.next_sample - int(STAMPS_SECONDS * device.sample_rate)
        while len(device.stamps) > 1 and device.stamps[1][0] <= horizon:
            device.stamps.popleft()
        for channel in device.channels:
            words = channel.decoder.push(np.ascontiguousarray(item.samples[:, channel.number]))
            notices += _breaks(device, channel, words)
            notices += _choose(device, channel, words)
            readings += _read(device, channel, words)
        return StepResult(tuple(readings), tuple(notices))

    def flush(self) -> StepResult[TimecodeReading]:
        """Words that end with the stream."""
        readings = [r for device in self._devices.values() for r in self._finish(device)]
        self.reset()
        return StepResult(tuple(readings))

    def reset(self) -> None:
        """Forget all devices."""
        self._devices = {}

    def _clocks(self, block: AudioBlock) -> tuple[str, ...]:
        """Of the channels; empty: nobody names any."""
        named = self._named.get(block.device, block.clocks)
        if named and len(named) != block.samples.shape[1]:
            raise DataError(
                f"timecode.channels names {len(named)} channels of {block.device} ({', '.join(named)}), but "
                f"its sound has {block.samples.shape[1]}"
            )
        return named

    def _start(self, block: AudioBlock, clocks: tuple[str, ...]) -> Device:
        """Begin with the decoders of the channels; one that is named as its device tells of its own clock."""
        names: list[str | None] = [None] * block.samples.shape[1] if not clocks else list(clocks)
        channels = [
            Channel(number, "" if name == block.device else name, LtcDecoder(self._config, block.sample_rate))
            for number, name in enumerate(names)
            if name != ""
        ]
        return Device(block.device, block.sample_rate, block.first_sample, clocks, channels)

    def _finish(self, device: Device) -> list[TimecodeReading]:
        """Words that end with the stream of a device."""
        readings = []
        for channel in device.channels:
            words = channel.decoder.finish()
            _choose(device, channel, words)
            readings += _read(device, channel, words)
        return readings


def _continues(device: Device, block: AudioBlock, clocks: tuple[str, ...]) -> bool:
    """Whether a block is what comes next of a device."""
    return (
        block.first_sample == device.next_sample
        and block.sample_rate == device.sample_rate
        and clocks == device.clocks
        and (not device.channels or device.channels[-1].number < block.samples.shape[1])
    )


def _choose(device: Device, channel: Channel, words: list[Word]) -> list[Notice]:
    """Of channels that nobody named, the first that is understood counts; told once if others carry another
    timecode."""
    if not words or channel.clock is not None:
        return []
    if device.main is None:
        device.main = channel.number
    if device.main == channel.number or device.several:
        return []
    counts = next(each for each in device.channels if each.number == device.main)
    if counts.last is None or channel.last is None or is_one_timecode(counts.last, channel.last):
        return []
    device.several = True
    text = (
        f"{device.name} hears timecode on channels {device.main} and {channel.number}; that of {device.main} "
        "counts. Name their clocks in sound.yaml or timecode.channels"
    )
    return [Notice("timecode.several", "warning", text, {"device": device.name})]


def _read(device: Device, channel: Channel, words: list[Word]) -> list[TimecodeReading]:
    if channel.clock is None and channel.number != device.main:
        return []
    return [
        TimecodeReading(
            device=device.name,
            stamp_ns=_stamp(device, device.first_sample + word.start),
            timecode=word.timecode,
            start_sample=device.first_sample + word.start,
            std_samples=word.std,
            reverse=word.reverse,
            user_bits=word.user_bits,
            clock=channel.clock or "",
            sample_rate=device.sample_rate,
        )
        for word in words
    ]


def _breaks(device: Device, channel: Channel, words: list[Word]) -> list[Notice]:
    """Notices where labels or samples do not continue those of the last word."""
    notices: list[Notice] = []
    for word in words:
        heard = Heard(word, _stamp(device, device.first_sample + word.start))
        found = find_break(device.name, device.sample_rate, channel.last, heard) if channel.last else ()
        if found is not None:
            notices += found
            channel.last = heard
    return notices


def _stamp(device: Device, sample: float) -> int:
    """The instant of a fractional sample on the device's clock, from the block that holds it."""
    first, stamp = next((block for block in reversed(device.stamps) if block[0] <= sample), device.stamps[0])
    return max(0, stamp + round((sample - first) / device.sample_rate * 1e9))


def _gap(device: Device, block: AudioBlock) -> Notice:
    lost = block.first_sample - device.next_sample
    if block.sample_rate != device.sample_rate:
        text = f"audio of {device.name} changed from {device.sample_rate} to {block.sample_rate} Hz"
    elif lost:
        what = f"lost {lost} samples" if lost > 0 else f"went back by {-lost} samples"
        text = f"audio of {device.name} {what} before sample {block.first_sample}"
    else:
        text = f"audio of {device.name} has other channels from sample {block.first_sample} on"
    return Notice("timecode.gap", "warning", text, {"device": device.name})
