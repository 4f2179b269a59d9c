"""Decodes the sound of recordings before a run, until the models of their clocks are known."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Protocol

from panoptic_ros.clocks.config import ClocksConfig
from panoptic_ros.clocks.stage import ClocksStage
from panoptic_ros.domain import AudioBlock, ClockModel, TimecodeReading
from panoptic_ros.errors import DataError
from panoptic_ros.params import Config, config_of
from panoptic_ros.stage import Notice
from panoptic_ros.timecode.config import TimecodeConfig
from panoptic_ros.timecode.stage import TimecodeStage

SECOND = 1_000_000_000
LONGEST_S = 120.0  # s, maximum duration of decoded sound
BEFORE_S = 0.5  # s of sound that a decoder needs before the first timecode word
EARLY_S = 2.0  # s; a shorter beginning of a recording is not skipped


class SoundDevice(Protocol):
    """Device with its recorded sound."""

    @property
    def device(self) -> str:
        """Return the name of the device."""

    @property
    def blocks(self) -> Callable[[], Iterator[AudioBlock]] | None:
        """Return a function that reads the sound from its beginning; None if the device is live."""


@dataclass
class DecodedSound:
    """Result of decoding the sound.

    Args:
        models: Models of the clocks, to master time, by clock.
        words: First timecode reading by device and clock.
        begins: Index of the first sample that is needed, by device.
        firsts: Timestamp of that sample, ns, by device.
        notices: Warnings from the stages, as text.
        seconds: Duration of the decoded sound, s.
    """

    models: dict[str, ClockModel] = field(default_factory=dict)
    words: dict[tuple[str, str], TimecodeReading] = field(default_factory=dict)
    begins: dict[str, int] = field(default_factory=dict)
    firsts: dict[str, int] = field(default_factory=dict)
    notices: list[str] = field(default_factory=list)
    seconds: float = 0.0

    def told(self, notices: Sequence[Notice]) -> None:
        """Store the texts of all warnings and errors."""
        self.notices += [notice.text for notice in notices if notice.severity != "info"]


def hear(
    recorders: Sequence[SoundDevice], configs: Mapping[str, Config], wanted: Collection[str]
) -> DecodedSound:
    """Decode sound until all wanted clocks have models, or until the sound ends.

    It stops after `LONGEST_S` in any case.

    Raises:
        DataError: if sound cannot be read.
    """
    found = DecodedSound()
    timecode = TimecodeStage(config_of(configs, TimecodeConfig))
    clocks = ClocksStage(config_of(configs, ClocksConfig))
    first: dict[str, AudioBlock] = {}
    for found.seconds, block in _side_by_side(recorders):
        if set(wanted) <= found.models.keys() or found.seconds > LONGEST_S:
            break
        first.setdefault(block.device, block)
        result = timecode.step(block)
        found.told(result.notices)
        _take(found, clocks, result.outputs)
    else:
        _take(found, clocks, timecode.flush().outputs)
        found.models |= {model.device: model for model in clocks.flush().outputs}
    for device, block in first.items():
        found.begins[device] = begin = _begin(found, block)
        found.firsts[device] = block.stamp_ns + (begin - block.first_sample) * SECOND // block.sample_rate
    return found


def _take(found: DecodedSound, clocks: ClocksStage, readings: Sequence[TimecodeReading]) -> None:
    for reading in readings:
        found.words.setdefault((reading.device, reading.clock), reading)
        result = clocks.step(reading)
        found.told(result.notices)
        found.models |= {model.device: model for model in result.outputs}


def _begin(found: DecodedSound, first: AudioBlock) -> int:
    """Return the first sample that is needed from a device.

    It lies shortly before the latest of the device's first timecode words. A short beginning is not skipped.
    """
    words = [word.start_sample for (device, _), word in found.words.items() if device == first.device]
    begin = int(max(words, default=0.0) - BEFORE_S * first.sample_rate)
    return begin if begin - first.first_sample > EARLY_S * first.sample_rate else first.first_sample


def _side_by_side(recorders: Sequence[SoundDevice]) -> Iterator[tuple[float, AudioBlock]]:
    """Yield (time since the device's first sample, s, block) of all devices in order of that time."""
    for _, since, block in heapq.merge(
        *(_timed(k, recorder) for k, recorder in enumerate(recorders)), key=lambda row: (row[1], row[0])
    ):
        yield since, block


def _timed(order: int, recorder: SoundDevice) -> Iterator[tuple[int, float, AudioBlock]]:
    blocks = iter(recorder.blocks() if recorder.blocks is not None else ())
    first = next(blocks, None)
    if first is None:
        raise DataError(f"the sound of {recorder.device} is empty")
    for block in chain([first], blocks):
        yield order, (block.first_sample - first.first_sample) / block.sample_rate, block
