"""Timecode stage: decode the audio blocks of any number of devices into timecode readings.

The stage keeps one `DeviceStream` record per device, with one decoder per channel. `compile_kernels` calls
every compiled loop of the timecode package once, with the argument types of later calls.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from fractions import Fraction
from functools import lru_cache

import numpy as np

from panoptic_ros.domain import AudioBlock, FrameRate, Timecode, TimecodeReading
from panoptic_ros.errors import DataError
from panoptic_ros.params import named_words
from panoptic_ros.stage import Notice, StageContext, StepResult
from panoptic_ros.state import Fields, Stateful, StateLayout
from panoptic_ros.timecode.config import TimecodeConfig
from panoptic_ros.timecode.decoder import LtcDecoder
from panoptic_ros.timecode.follow.breaks import WordReading, find_break, is_one_timecode
from panoptic_ros.timecode.follow.following import SignalTracker
from panoptic_ros.timecode.follow.reading import Word
from panoptic_ros.timecode.follow.wander import Wander
from panoptic_ros.timecode.label.counting import LabelSequence
from panoptic_ros.timecode.label.evidence import LabelLikelihood, LabelScore, UserBits
from panoptic_ros.timecode.label.expected import ExpectedLabels
from panoptic_ros.timecode.label.stretch import StretchLabels
from panoptic_ros.timecode.signal.clicks import ClickLimits, bridge_clicks
from panoptic_ros.timecode.signal.conditioning import Conditioner, between, hat_sums, high_pass, limit
from panoptic_ros.timecode.signal.half_cells import CellGrid, half_levels, moved_grid, tick_levels
from panoptic_ros.timecode.signal.stream import Buffer, Hops, Stream
from panoptic_ros.timecode.word.edges import EVEN, fit_edges
from panoptic_ros.timecode.word.layout import FREE
from panoptic_ros.timecode.word.search import best_grid, scan_lengths, sync_means
from panoptic_ros.timecode.word.tracking import track
from panoptic_ros.timecode.word.viterbi import WordLevels, best_path, match, soft_bits

STAMPS_SECONDS = 3.0  # s of block timestamps to keep: longer than any word is held back


@dataclass
class Channel:
    """One channel of a device that is searched for timecode.

    Args:
        number: channel index, from 0.
        clock: name of the clock whose timecode the channel carries. "" = the device's own clock, None = not
            named.
        decoder: decoder of the channel's samples.
        last: (None before the first) last word of the channel. The next word is checked against it for jumps
            and lost audio.
    """

    number: int
    clock: str | None
    decoder: LtcDecoder
    last: WordReading | None = None


@dataclass
class DeviceStream:
    """One uninterrupted stream of a device.

    Args:
        clocks: (C,) clock names of all channels; empty if not named.
        stamps: (first sample index, timestamp in ns) of each recent block.
        next_sample: (index) first sample of the next block.
        main: channel whose timecode counts for the device's own clock if channels are not named. The first
            channel decoded becomes the main channel.
        several: True once an unnamed channel carries a timecode different from that of `main`.
    """

    name: str
    sample_rate: int
    first_sample: int
    clocks: tuple[str, ...]
    channels: list[Channel]
    # index of the first sample and timestamp (ns) of each block
    stamps: deque[tuple[int, int]] = field(default_factory=deque)
    next_sample: int = 0
    main: int | None = None
    several: bool = False


LAYOUT = StateLayout(
    "timecode",
    ("_devices",),
    (
        Channel,
        ClickLimits,
        LabelSequence,
        DeviceStream,
        FrameRate,
        CellGrid,
        WordReading,
        StretchLabels,
        Timecode,
        LabelScore,
        Word,
        WordLevels,
        Fields.named(Fraction, "_numerator _denominator", is_value=True),
        Fields.named(LtcDecoder, "_config _hop _hops _stream _follow _held _read_until _searches"),
        Fields.named(Hops, "_length _pending _count"),
        Fields.named(Stream, "sample_rate first up _conditioner _recorded _sums"),
        Fields.named(Buffer, "values", make=Buffer.of),
        Fields.named(
            Conditioner, "up _step _low_pass _between _half _beside reach _piece _clicks _raw _history"
        ),
        Fields.named(
            SignalTracker,
            "grid number labels reverse wander misses read signal first _line _wavers _scatter",
        ),
        Fields.named(
            ExpectedLabels,
            "user _solution _countings _rates _ahead _evidence _labels _verdicts _last_ahead",
        ),
        Fields.named(Wander, "reverse level _place _cell _tracked"),
        Fields.named(UserBits, "_nats certain _other _bits _value"),
        Fields.named(LabelLikelihood, "_levels _free _user contradiction same_user"),
    ),
    shared=("_config",),
    same={"configuration": "_config"},
)


@lru_cache(maxsize=1)
def compile_kernels() -> None:
    """Compile all kernels or load them from numba's cache, so that a running stream does not wait for it."""
    _compile_conditioning()
    _compile_words()


def _compile_conditioning() -> None:
    limit(np.ones(400), 100, 0.8, 2.0, 3.0)
    bridge_clicks(np.ones(400), ClickLimits(20, 100, 0.8, 2.0, 5))
    hat_sums(np.ones((1, 400)), 1)
    high_pass(np.ones(400), np.ones(400), np.ones(5), 1)
    between(np.ones(400), np.ones((1, 4)))


def _compile_words() -> None:
    sums, grid, few = np.cumsum(np.ones(400)), CellGrid(200.0, 20.0), np.zeros(1)
    halves, wanted = np.ones(16), np.full(8, FREE, np.int8)
    half_levels(sums, grid, -4.0, 8)
    tick_levels(sums, track(sums, 20.0, 8.0, 10, 1.0))
    best_grid(sums, grid, -4.0, 8, few, few)
    scan_lengths(sums, 0.0, 200.0, np.array([10.0]), 2)
    signs = best_path(halves, wanted, 0.0).signs
    soft_bits(halves, wanted, 0.0)
    sync_means(wanted, wanted[:4], 4)
    moved_grid(grid, 1.0)
    fit_edges(sums, grid.middle + np.arange(-80.0, 81.0), np.repeat(signs, 10), 1.0, EVEN)
    match(halves, wanted, 0.0, 0.0)


class TimecodeStage(Stateful):
    """Stage that decodes `AudioBlock`s into `TimecodeReading`s; see the package docstring.

    A gap in the samples or a changed sample rate discards the state of the device and starts a new decoder.

    If the channels of a device have clock names, each channel with a name gets a decoder. Otherwise every
    channel gets one, and the first channel decoded gives the timecode of the device's own clock.

    The constructor compiles the kernels or loads them from numba's cache.
    """

    LAYOUT = LAYOUT

    def __init__(self, config: TimecodeConfig, context: StageContext | None = None):
        self._config = config
        self._named = {
            device: tuple(name.strip() for name in names.split(","))
            for device, names in named_words("TimecodeConfig.channels", config.channels).items()
        }
        self._devices: dict[str, DeviceStream] = {}
        compile_kernels()

    def step(self, item: AudioBlock) -> StepResult[TimecodeReading]:
        """Return the readings that the block completes.

        Raises:
            DataError: the number of channels differs from the number of clock names.
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
        """Return the readings completed by the end of the stream, and reset the stage."""
        readings = [r for device in self._devices.values() for r in self._finish(device)]
        self.reset()
        return StepResult(tuple(readings))

    def reset(self) -> None:
        """Drop the state of all devices."""
        self._devices = {}

    def _clocks(self, block: AudioBlock) -> tuple[str, ...]:
        """Return the clock name of each channel of a block; empty if the channels are not named.

        The parameter `timecode.channels` takes precedence over the names in the block.
        """
        named = self._named.get(block.device, block.clocks)
        if named and len(named) != block.samples.shape[1]:
            raise DataError(
                f"timecode.channels names {len(named)} channels of {block.device} ({', '.join(named)}), but "
                f"its sound has {block.samples.shape[1]}"
            )
        return named

    def _start(self, block: AudioBlock, clocks: tuple[str, ...]) -> DeviceStream:
        """Create the device record, with one decoder per channel that may carry timecode.

        A channel with the name of its own device carries the timecode of the device's own clock.
        """
        names: list[str | None] = [None] * block.samples.shape[1] if not clocks else list(clocks)
        channels = [
            Channel(number, "" if name == block.device else name, LtcDecoder(self._config, block.sample_rate))
            for number, name in enumerate(names)
            if name != ""
        ]
        return DeviceStream(block.device, block.sample_rate, block.first_sample, clocks, channels)

    def _finish(self, device: DeviceStream) -> list[TimecodeReading]:
        """Return the readings completed by the end of a device's stream."""
        readings = []
        for channel in device.channels:
            words = channel.decoder.finish()
            _choose(device, channel, words)
            readings += _read(device, channel, words)
        return readings


def _continues(device: DeviceStream, block: AudioBlock, clocks: tuple[str, ...]) -> bool:
    """Return whether a block directly continues the stream of a device."""
    return (
        block.first_sample == device.next_sample
        and block.sample_rate == device.sample_rate
        and clocks == device.clocks
        and (not device.channels or device.channels[-1].number < block.samples.shape[1])
    )


def _choose(device: DeviceStream, channel: Channel, words: list[Word]) -> list[Notice]:
    """Select the main channel of a device with unnamed channels: the first one decoded.

    Returns: one notice per device, the first time that another channel carries a different timecode.
    """
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
        f"{device.name} has timecode on channels {device.main} and {channel.number}; that of "
        f"{device.main} counts. Name their clocks in sound.yaml or timecode.channels"
    )
    return [Notice("timecode.several", "warning", text, {"device": device.name})]


def _read(device: DeviceStream, channel: Channel, words: list[Word]) -> list[TimecodeReading]:
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


def _breaks(device: DeviceStream, channel: Channel, words: list[Word]) -> list[Notice]:
    """Return notices for words whose labels or samples do not continue those of the previous word."""
    notices: list[Notice] = []
    for word in words:
        heard = WordReading(word, _stamp(device, device.first_sample + word.start))
        found = find_break(device.name, device.sample_rate, channel.last, heard) if channel.last else ()
        if found is not None:
            notices += found
            channel.last = heard
    return notices


def _stamp(device: DeviceStream, sample: float) -> int:
    """Return the timestamp (ns, device clock) of a fractional sample, from the block that contains it."""
    first, stamp = next((block for block in reversed(device.stamps) if block[0] <= sample), device.stamps[0])
    return max(0, stamp + round((sample - first) / device.sample_rate * 1e9))


def _gap(device: DeviceStream, block: AudioBlock) -> Notice:
    lost = block.first_sample - device.next_sample
    if block.sample_rate != device.sample_rate:
        text = f"audio of {device.name} changed from {device.sample_rate} to {block.sample_rate} Hz"
    elif lost:
        what = f"lost {lost} samples" if lost > 0 else f"went back by {-lost} samples"
        text = f"audio of {device.name} {what} before sample {block.first_sample}"
    else:
        text = f"audio of {device.name} has other channels from sample {block.first_sample} on"
    return Notice("timecode.gap", "warning", text, {"device": device.name})
